"""Categories that stand on the floor, that hang, and that end at a level top, if the name determines it.

The lists are in `category_rules.txt`, because hypernyms do not contain this: a mirror and a wardrobe are furniture, a
wall clock and a washing machine are devices. They determine whether an object whose foot is not reconstructed is
extended downwards. A caller with better information passes its own function (`MeasurementOptions.standing`).
"""

from __future__ import annotations

from pathlib import Path

from metric_base.text_tables import named_texts

_LISTS = {
    name: frozenset(text.split(", "))
    for name, text in named_texts(Path(__file__).with_name("category_rules.txt")).items()
}


def stands_on_floor(category: str) -> bool | None:
    """Return True if a category stands on the floor, False if it hangs, and None if its name does not determine it."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    for phrase in (" ".join(words), " ".join(words[-2:]), " ".join(words[-1:])):
        if any(phrase in _LISTS[name] for name in ("floor", "hung", "either")):
            return True if phrase in _LISTS["floor"] else False if phrase in _LISTS["hung"] else None
    return None


def has_level_top(category: str) -> bool:
    """Return whether the height of a category ends at a level top."""
    words = category.lower().replace("_", " ").replace("-", " ").split()
    return bool(words) and words[-1] in _LISTS["level"]
