"""A finding of a check."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """A finding of a check of a release."""

    code: str  #: E for an error, W for a warning, and three digits.
    subject: str  #: Id of a node or an item, or name of a file.
    message: str  #: Expected and found value.

    @property
    def is_error(self) -> bool:
        """Return True if the release violates the format."""
        return self.code.startswith("E")
