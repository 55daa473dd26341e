"""The one table of length units, in millimetres."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from crawler.faults import InputFault

__all__ = ["MILLIMETRES", "UnknownUnit", "millimetres"]


class UnknownUnit(InputFault):
    """A unit of length that the table does not hold."""


#: Millimetres in one unit. The inch is 25.4 mm exactly (international yard and pound agreement, 1959).
MILLIMETRES: Mapping[str, float] = MappingProxyType(
    {
        "um": 1e-3,
        "mm": 1.0,
        "cm": 10.0,
        "dm": 100.0,
        "m": 1000.0,
        "km": 1e6,
        "in": 25.4,
        "ft": 304.8,
        "yd": 914.4,
        "mi": 1609344.0,
    }
)


def millimetres(value: float, unit: str) -> float:
    """`value` of `unit` in millimetres.

    Raises
    ------
    UnknownUnit
        The unit is not a key of `MILLIMETRES`.
    """
    try:
        return value * MILLIMETRES[unit]
    except KeyError:
        raise UnknownUnit(f"unit: expected one of {', '.join(MILLIMETRES)}; found {unit!r}") from None
