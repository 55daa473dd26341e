"""One finding of a check."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """What a check found: its code (E error, W warning), where, and expected against found."""

    code: str
    subject: str
    message: str

    @property
    def is_error(self) -> bool:
        """Return True if the release breaks the format."""
        return self.code.startswith("E")
