"""Regions of the world: a short list, and the countries (ISO 3166-1 alpha-2) of each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

_LINES = Path(__file__).with_name("regions.txt").read_text(encoding="utf-8").splitlines()
#: Country codes of each region.
_CODES: Mapping[str, list[str]] = {line.split()[0]: line.split()[1:] for line in _LINES if not line.startswith("#")}

#: Region of each country code; Antarctica and the uninhabited Bouvet Island have none.
COUNTRIES: Mapping[str, str] = {code: region for region, codes in _CODES.items() for code in codes}

#: Regions of the world, and `world` for sizes without a region.
REGIONS = frozenset({"world", *_CODES})


def region_of(place: str) -> str | None:
    """Return the region of a country code or of a region; None for other texts.

    >>> region_of("DE"), region_of("europe"), region_of("Germany")
    ('europe', 'europe', None)
    """
    return place if place in REGIONS else COUNTRIES.get(place)


def country_of(name: str) -> str | None:
    """Return the code of a country by its English or native name; None for other texts.

    >>> country_of("Germany"), country_of("usa"), country_of("Atlantis")
    ('DE', 'US', None)
    """
    return _country_names().get(" ".join(name.casefold().replace("-", " ").replace("_", " ").split()))


@cache
def _country_names() -> Mapping[str, str]:
    lines = Path(__file__).with_name("country_names.txt").read_text(encoding="utf-8").splitlines()
    rows = (line.partition(" ") for line in lines)
    return {name.replace("-", " "): code for code, _, names in rows for name in names.split("; ")}
