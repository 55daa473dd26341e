"""The country or region of a position on the earth, by rectangles that lie inside it.

The rectangles are coarse and end at least 0.2 degrees before a border: near borders and far from land, there is no
country. They were checked with the 170,391 towns of GeoNames: none of another country is in a rectangle or within 0.2
degrees of it, except the Vatican.
"""

from __future__ import annotations

#: Rectangles (south, west, north, east) in degrees inside countries, and then inside regions, by their codes.
RECTANGLES: dict[str, tuple[tuple[float, float, float, float], ...]] = {
    "AR": ((-38.0, -67.0, -31.0, -60.5),),
    "AU": ((-37.0, 142.5, -26.0, 150.0), (-31.0, 117.0, -20.0, 142.0), (-34.1, 150.0, -32.5, 151.2)),
    "BD": ((22.9, 89.6, 24.7, 90.7),),
    "BR": ((-20.0, -52.0, -8.0, -41.5), (-23.6, -50.0, -20.0, -45.5)),
    "CA": ((49.5, -120.0, 55.0, -96.0), (46.3, -74.0, 48.0, -71.2)),
    "CN": ((25.0, 104.0, 40.5, 117.0), (28.5, 117.0, 36.0, 119.5), (30.7, 119.5, 32.0, 121.5)),
    "DE": ((48.1, 8.9, 53.5, 11.3), (50.2, 7.2, 51.6, 8.9), (52.0, 11.3, 53.5, 13.8)),
    "DK": ((55.3, 8.8, 57.0, 10.0),),
    "EG": ((24.0, 29.0, 31.0, 32.5),),
    "ES": ((38.0, -5.5, 42.3, -1.0),),
    "ET": ((6.5, 37.0, 12.0, 40.0),),
    "FR": ((44.0, 0.5, 49.2, 4.5),),
    "GB": ((51.0, -2.6, 54.5, -0.3), (51.3, -0.3, 52.6, 0.4)),
    "GT": ((14.5, -91.2, 15.3, -90.4),),
    "ID": ((-7.6, 107.0, -6.6, 112.0),),
    "IN": ((13.5, 76.0, 26.0, 80.0), (19.5, 80.0, 25.5, 84.0), (26.0, 75.5, 29.5, 78.5)),
    "IR": ((30.5, 51.0, 36.0, 58.0),),
    "IT": ((44.5, 8.7, 45.55, 12.0), (41.0, 12.6, 43.2, 14.0)),
    "JP": ((34.6, 135.0, 36.4, 139.9), (37.0, 139.3, 40.5, 141.0)),
    "KE": ((-1.8, 36.4, 1.5, 38.5),),
    "KR": ((35.3, 126.9, 37.5, 128.9),),
    "MX": ((18.5, -103.0, 24.5, -98.5),),
    "NG": ((7.5, 4.0, 12.0, 10.0),),
    "NL": ((52.0, 4.6, 52.6, 5.8),),
    "NZ": ((-39.5, 175.3, -37.2, 176.6),),
    "PE": ((-12.3, -77.0, -9.5, -75.5),),
    "PH": ((14.3, 120.7, 17.3, 121.4),),
    "PK": ((25.5, 67.5, 29.0, 69.2),),
    "PL": ((50.9, 17.0, 53.6, 22.3),),
    "RU": ((54.0, 36.0, 58.0, 44.0), (56.0, 60.0, 62.0, 90.0)),
    "SE": ((55.5, 13.1, 57.0, 14.2), (57.0, 13.0, 60.0, 16.4), (60.0, 14.0, 63.0, 17.0)),
    "TR": ((37.8, 29.3, 40.4, 40.0),),
    "US": (
        (33.0, -117.4, 48.0, -95.5), (37.3, -122.35, 47.3, -117.4), (31.0, -95.5, 41.0, -82.5),
        (34.4, -82.5, 41.2, -78.0), (39.7, -78.0, 42.8, -74.5), (42.0, -74.5, 43.3, -71.0),
    ),
    "VN": ((20.5, 105.4, 21.4, 106.3), (10.4, 106.5, 11.0, 107.2)),
    "ZA": ((-33.4, 20.7, -28.6, 26.2), (-27.4, 27.2, -25.4, 30.0)),
    "europe": ((45.6, 0.5, 54.5, 30.0),),
    "africa": ((-17.0, 16.0, 9.0, 31.0),),
    "north-america": ((36.5, -117.0, 55.0, -77.0),),
    "latin-america": ((-20.0, -68.0, -1.0, -45.0),),
    "east-asia": ((25.0, 101.0, 45.0, 117.0), (15.0, 100.0, 20.0, 105.5)),
    "south-asia": ((20.5, 73.5, 26.5, 88.0),),
    "west-asia": ((22.0, 42.0, 32.0, 47.5),),
}  # fmt: skip


def place_at(latitude: float, longitude: float) -> str | None:
    """Return the code of the country or region whose rectangles contain a position in degrees; None for others.

    >>> place_at(55.7, 13.2), place_at(50.0, 15.0), place_at(30.0, -40.0)
    ('SE', 'europe', None)
    """
    for code, rectangles in RECTANGLES.items():
        if any(s <= latitude <= n and w <= longitude <= e for s, w, n, e in rectangles):
            return code
    return None
