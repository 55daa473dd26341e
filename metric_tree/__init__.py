"""Metric-Tree: object sizes by category, in a tree of five levels, with a prior on every node.

>>> import metric_tree
>>> tree = metric_tree.open()
>>> tree.find("swivel chair").prior(("height",)).interval(0.9).shape  # low and high, millimetres
(1, 2)
"""

from importlib import import_module
from typing import TYPE_CHECKING

from metric_tree.node import AmbiguousName, Node, NoPrior, UnknownName
from metric_tree.prior import Prior
from metric_tree.release.release import BadRelease
from metric_tree.tree import Tree
from metric_tree.tree import open_tree as open  # noqa: A004 - as in gzip.open

if TYPE_CHECKING:
    from metric_tree.pipeline.build import Build, BuildOptions, build_release

__all__ = [
    "AmbiguousName",
    "BadRelease",
    "Build",
    "BuildOptions",
    "NoPrior",
    "Node",
    "Prior",
    "Tree",
    "UnknownName",
    "build_release",
    "open",
]

#: The name in its module of what is imported when it is first used, so that a query stays light.
_LATE = ("Build", "BuildOptions", "build_release")


def __getattr__(name: str) -> object:
    if name not in _LATE:
        raise AttributeError(f"module 'metric_tree' has no attribute {name!r}")
    return getattr(import_module("metric_tree.pipeline.build"), name)
