"""The names that a detector's numbers stand for."""

from __future__ import annotations

from taxonomy.label_lists import vocabulary

__all__ = ["label_names"]

#: COCO's category ids run to 90, of which these ten name nothing; torchvision's labels are these ids.
COCO_91_GAPS = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})


def label_names(name: str) -> tuple[str, ...]:
    """Names by label number: `coco_91` for COCO's own ids, else a shipped list counted from 1."""
    if name != "coco_91":
        return ("", *(label.label for label in vocabulary(name)))
    remaining = iter(vocabulary("coco_80"))
    return ("", *("" if number in COCO_91_GAPS else next(remaining).label for number in range(1, 91)))
