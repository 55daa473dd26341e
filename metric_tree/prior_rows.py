"""The table of priors of a release: read when the first prior is asked for, each prior made once."""

from __future__ import annotations

from collections import defaultdict
from functools import cached_property

import pyarrow as pa

from metric_tree.node import NoPrior
from metric_tree.prior import Prior
from metric_tree.release.release import Release

__all__ = ["PriorRows"]


class PriorRows:
    """The priors of a release by node and dimensions."""

    def __init__(self, release: Release) -> None:
        self._release = release
        self._priors: dict[tuple[str, tuple[str, ...]], Prior] = {}

    def dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions for which a node has a fitted row."""
        return tuple(dims for dims, _ in self._rows(node_id))

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """The prior of a node over `dims`, from its row with the fewest dimensions that hold them."""
        key = (node_id, dims)
        if key not in self._priors:
            self._priors[key] = self._read(node_id, dims)
        return self._priors[key]

    def _read(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        rows = self._rows(node_id)
        containing = [(len(had), row) for had, row in rows if set(dims) <= set(had)]
        if not containing or not dims:
            exists = "; ".join(", ".join(had) for had, _ in rows) or "none"
            wanted = ", ".join(dims) or "no dimension"
            raise NoPrior(f"{node_id}: dims: expected a prior that holds {wanted}; found {exists}")
        prior = Prior.of_row(self._table.slice(min(containing)[1], 1).to_pylist()[0])
        return prior if prior.dims == dims else prior.marginal(dims)

    def _rows(self, node_id: str) -> list[tuple[tuple[str, ...], int]]:
        """Dimensions and rows of the priors of a node."""
        dims, places = self._table["dims"], self._places.get(node_id, ())
        return [(tuple(dims[place].as_py()), place) for place in places]

    @cached_property
    def _table(self) -> pa.Table:
        return self._release.table("priors")

    @cached_property
    def _places(self) -> dict[str, list[int]]:
        """Rows of the table by node."""
        places: defaultdict[str, list[int]] = defaultdict(list)
        for place, node_id in enumerate(self._table["node_id"].to_pylist()):
            places[node_id].append(place)
        return places
