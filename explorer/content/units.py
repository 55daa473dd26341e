"""Lengths for people: millimetres as the unit in which such a size is named."""

from __future__ import annotations

__all__ = ["length_text", "number_text", "range_text"]

#: Unit, millimetres in it, and the size in mm from which it is used.
_UNITS = (("km", 1e6, 2e6), ("m", 1e3, 1e3), ("cm", 10.0, 20.0), ("mm", 1.0, 0.0))


def _unit(mm: float) -> tuple[str, float]:
    return next((name, factor) for name, factor, least in _UNITS if mm >= least)


def number_text(value: float) -> str:
    """A number with three significant digits at most, without an exponent."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def length_text(mm: float) -> str:
    """A length in the unit in which such a size is named.

    >>> length_text(91.4), length_text(4500), length_text(0.25)
    ('9.14 cm', '4.5 m', '0.25 mm')
    """
    unit, factor = _unit(mm)
    return f"{number_text(mm / factor)} {unit}"


def range_text(low: float, high: float) -> str:
    """Two lengths in the unit of the higher one.

    >>> range_text(80, 120)
    '8 to 12 cm'
    """
    unit, factor = _unit(high)
    return f"{number_text(low / factor)} to {number_text(high / factor)} {unit}"
