"""The five kinds of rooms of the paper's indoor set, and their furniture."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KINDS", "RoomKind"]


@dataclass(frozen=True, slots=True)
class RoomKind:
    """Floor (x, y) in metres, radius of the walk, and furniture (category, minimum and maximum number, placement rule).

    A rule is `wall`, `centre`, `floor`, `at A|B` (next to an object of these categories) or `on A|B` (on top of one).
    """

    floor: tuple[float, float]
    radius: float
    furniture: tuple[tuple[str, int, int, str], ...]


KINDS: dict[str, RoomKind] = {
    "sitting room": RoomKind(
        (5.4, 4.8),
        2.05,
        (
            ("couch", 1, 1, "wall"),
            ("tv stand", 1, 1, "wall"),
            ("bookcase", 1, 1, "wall"),
            ("coffee table", 1, 1, "centre"),
            ("armchair", 1, 2, "floor"),
            ("tv", 1, 1, "on tv stand"),
            ("floor lamp", 0, 1, "wall"),
            ("potted plant", 1, 2, "floor"),
            ("stool", 0, 1, "floor"),
            ("cup", 1, 3, "on coffee table"),
            ("book", 1, 3, "on coffee table"),
            ("bottle", 0, 2, "on coffee table"),
            ("vase", 1, 1, "on coffee table|tv stand"),
            ("teddy bear", 0, 1, "on coffee table|tv stand"),
            ("remote", 0, 1, "on coffee table"),
        ),
    ),
    "kitchen": RoomKind(
        (4.9, 4.5),
        1.9,
        (
            ("refrigerator", 1, 1, "wall"),
            ("cabinet", 1, 2, "wall"),
            ("dining table", 1, 1, "centre"),
            ("chair", 2, 4, "at dining table"),
            ("trash can", 1, 1, "wall"),
            ("microwave", 1, 1, "on cabinet|dining table"),
            ("toaster", 0, 1, "on cabinet|dining table"),
            ("kettle", 1, 1, "on dining table|cabinet"),
            ("bottle", 2, 4, "on dining table|cabinet"),
            ("cup", 2, 3, "on dining table"),
            ("bowl", 1, 2, "on dining table"),
            ("vase", 0, 1, "on dining table"),
        ),
    ),
    "toilet": RoomKind(
        (3.9, 3.6),
        1.45,
        (
            ("toilet", 1, 1, "wall"),
            ("washing machine", 1, 1, "wall"),
            ("bathtub", 0, 1, "wall"),
            ("cabinet", 0, 1, "wall"),
            ("trash can", 1, 1, "floor"),
            ("stool", 1, 1, "floor"),
            ("bottle", 2, 4, "on washing machine|stool|cabinet"),
            ("cup", 1, 1, "on washing machine|stool|cabinet"),
            ("potted plant", 0, 1, "floor"),
        ),
    ),
    "bedroom": RoomKind(
        (5.4, 5.0),
        2.1,
        (
            ("bed", 1, 1, "wall"),
            ("wardrobe", 1, 1, "wall"),
            ("nightstand", 1, 2, "wall"),
            ("dresser", 1, 1, "wall"),
            ("chair", 1, 1, "floor"),
            ("lamp", 1, 1, "on nightstand|dresser"),
            ("alarm clock", 1, 1, "on nightstand|dresser"),
            ("book", 1, 3, "on nightstand|dresser"),
            ("vase", 0, 1, "on dresser"),
            ("potted plant", 0, 1, "floor"),
            ("suitcase", 1, 1, "floor"),
            ("teddy bear", 0, 1, "on dresser"),
            ("cup", 0, 1, "on nightstand|dresser"),
        ),
    ),
    "study": RoomKind(
        (4.7, 4.3),
        1.8,
        (
            ("bookcase", 1, 2, "wall"),
            ("desk", 1, 1, "centre"),
            ("office chair", 1, 1, "at desk"),
            ("cabinet", 0, 1, "wall"),
            ("monitor", 1, 1, "on desk"),
            ("laptop", 0, 1, "on desk"),
            ("keyboard", 1, 1, "on desk"),
            ("mouse", 1, 1, "on desk"),
            ("lamp", 0, 1, "on desk|cabinet"),
            ("cup", 1, 2, "on desk"),
            ("book", 2, 4, "on desk|cabinet"),
            ("bottle", 0, 2, "on desk|cabinet"),
            ("printer", 1, 1, "on cabinet|desk"),
            ("trash can", 1, 1, "floor"),
            ("potted plant", 1, 1, "floor"),
            ("chair", 0, 1, "floor"),
        ),
    ),
}
