"""The one kind of fault that is the input's and not the program's: commands answer it with one line and exit 2."""

from __future__ import annotations

__all__ = ["InputFault"]


class InputFault(ValueError):
    """An input is at fault: the message names the file, the field, what was expected and what was found."""
