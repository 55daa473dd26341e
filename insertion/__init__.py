"""Insertion of virtual objects into images and video at their true size."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from insertion.insert import Insertion, insert_objects
    from insertion.request import InsertionRequest, ObjectRequest, SceneSource
    from insertion.result import InsertionResult

__all__ = ["Insertion", "InsertionRequest", "InsertionResult", "ObjectRequest", "SceneSource", "insert_objects"]

#: The module of each name; it is imported when the name is first used.
_HOMES = {
    "Insertion": "insertion.insert",
    "InsertionRequest": "insertion.request",
    "InsertionResult": "insertion.result",
    "ObjectRequest": "insertion.request",
    "SceneSource": "insertion.request",
    "insert_objects": "insertion.insert",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'insertion' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
