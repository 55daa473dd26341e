"""Metric-Tree: object sizes by category, in a tree of five levels, with a prior on every node.

>>> import metric_tree
>>> tree = metric_tree.open()
>>> tree.find("swivel chair").prior(("height",)).interval(0.9).shape  # low and high, millimetres
(1, 2)
"""

from typing import TYPE_CHECKING

from metric_base.lazy_names import lazy_names
from metric_tree.node import AmbiguousName, Node, NoPrior, UnknownName
from metric_tree.prior import Prior
from metric_tree.release.release import BadRelease
from metric_tree.tree import Tree
from metric_tree.tree import open_tree as open  # noqa: A004 - as in gzip.open

if TYPE_CHECKING:
    from metric_tree.pipeline.build import Build, BuildOptions, build_release
    from models3d.size_check.scale_for import FactorEvidence, ObjectScale, scale_for

__all__ = [
    "AmbiguousName",
    "BadRelease",
    "Build",
    "BuildOptions",
    "FactorEvidence",
    "NoPrior",
    "Node",
    "ObjectScale",
    "Prior",
    "Tree",
    "UnknownName",
    "build_release",
    "open",
    "scale_for",
]

#: Imported on first use, so that a query stays light.
__getattr__, __dir__, _ = lazy_names(
    __name__,
    {"pipeline.build": ("Build", "BuildOptions", "build_release")},
    {"models3d.size_check.scale_for": ("FactorEvidence", "ObjectScale", "scale_for")},
)
