"""Regions of the world: a short list, and the countries (ISO 3166-1 alpha-2) of each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from metric_base.text_tables import named_texts

#: Country codes of each region.
_CODES = named_texts(Path(__file__).with_name("regions.txt"))

#: Region of each country code; Antarctica and the uninhabited Bouvet Island have none.
COUNTRIES: Mapping[str, str] = {code: region for region, codes in _CODES.items() for code in codes.split()}

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
    rows = named_texts(Path(__file__).with_name("country_names.txt")).items()
    return {name.replace("-", " "): code for code, names in rows for name in names.split("; ")}
