"""From what the user has to a result: objects of a file, or a scene with its instances; with the time of each step."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from estimator.estimate import Options, estimated
from estimator.objects import MeasuredObject
from estimator.result import ScaleResult
from metric_tree.tree import Tree

__all__ = ["objects_result"]


def objects_result(
    objects: Sequence[MeasuredObject], tree: Tree, options: Options, paper_lists: Path | None = None
) -> ScaleResult:
    """The scale from sizes measured elsewhere."""
    if options.method == "paper":
        from estimator.baselines.paper import paper_result  # noqa: PLC0415 - loads scikit-learn

        return paper_result(objects, tree, options, paper_lists)
    return estimated(objects, tree, options)
