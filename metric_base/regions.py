"""Regions of the world: a short list, and the countries (ISO 3166-1 alpha-2) of each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

#: Country codes of each region. Cyprus, Georgia and Russia count as Europe, Egypt and its western neighbours as Africa,
#: South-East Asia as East Asia; the Middle East and Central Asia are West Asia.
_CODES: Mapping[str, str] = {
    "europe": "AD AL AM AT AX AZ BA BE BG BY CH CY CZ DE DK EE ES FI FO FR GB GE GG GI GR HR HU IE IM IS IT JE LI LT LU"
    " LV MC MD ME MK MT NL NO PL PT RO RS RU SE SI SJ SK SM UA VA XK",
    "north-america": "BM CA GL PM US UM",
    "latin-america": "AG AI AR AW BB BL BO BQ BR BS BZ CL CO CR CU CW DM DO EC FK GD GF GP GS GT GY HN HT JM KN KY LC"
    " MF MQ MS MX NI PA PE PR PY SR SV SX TC TT UY VC VE VG VI",
    "east-asia": "BN CN HK ID JP KH KP KR LA MM MN MO MY PH SG TH TL TW VN",
    "south-asia": "AF BD BT IN IO LK MV NP PK",
    "west-asia": "AE BH IL IQ IR JO KG KW KZ LB OM PS QA SA SY TJ TM TR UZ YE",
    "africa": "AO BF BI BJ BW CD CF CG CI CM CV DJ DZ EG EH ER ET GA GH GM GN GQ GW KE KM LR LS LY MA MG ML MR MU MW MZ"
    " NA NE NG RE RW SC SD SH SL SN SO SS ST SZ TD TF TG TN TZ UG YT ZA ZM ZW",
    "oceania": "AS AU CC CK CX FJ FM GU HM KI MH MP NC NF NR NU NZ PF PG PN PW SB TK TO TV VU WF WS",
}

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
    lines = Path(__file__).with_name("country_names.txt").read_text(encoding="utf-8").splitlines()
    rows = (line.partition(" ") for line in lines)
    return {name.replace("-", " "): code for code, _, names in rows for name in names.split("; ")}
