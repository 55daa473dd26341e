"""Insertion of virtual objects into images and video at their true size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names

if TYPE_CHECKING:
    from insertion.insert import Insertion as Insertion
    from insertion.insert import insert_objects as insert_objects
    from insertion.request import InsertionRequest as InsertionRequest
    from insertion.request import ObjectRequest as ObjectRequest
    from insertion.request import SceneSource as SceneSource
    from insertion.result import InsertionResult as InsertionResult

#: The module of each name; it is imported when the name is first used.
__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "insert": ("Insertion", "insert_objects"),
        "request": ("InsertionRequest", "ObjectRequest", "SceneSource"),
        "result": ("InsertionResult",),
    },
)
