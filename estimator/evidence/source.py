"""What every kind of evidence is to the pipeline: something that looks at a scene and says scales."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Scene

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["EvidenceSource", "silent"]


@runtime_checkable
class EvidenceSource(Protocol):
    """A kind of evidence that the user asked for."""

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """What it states about a scene, in metres per scene unit; one row with a reason where it cannot speak.

        Raises
        ------
        InputError
            A file that the user named cannot be read.
        """
        ...


def silent(kind: str, name: str, reason: str) -> tuple[ScaleEvidence, ...]:
    """The row of evidence that cannot speak."""
    return (ScaleEvidence(kind, name, None, None, reason=reason),)
