"""Metric-Tree: object sizes by category, in a tree of five levels, with a prior on every node.

>>> import metric_tree
>>> tree = metric_tree.open()
>>> tree.find("swivel chair").prior(("height",)).interval(0.9).shape  # low and high, millimetres
(1, 2)
"""

from metric_tree.prior import Prior
from metric_tree.release import BadRelease
from metric_tree.tree import AmbiguousName, Node, NoPrior, Tree, UnknownName
from metric_tree.tree import open_tree as open  # noqa: A004 - as in gzip.open

__all__ = ["AmbiguousName", "BadRelease", "NoPrior", "Node", "Prior", "Tree", "UnknownName", "open"]
