"""Compare the priors of a hundred everyday objects with sizes that were estimated independently.

    python -m benchmarks.metric_tree.everyday [RELEASE] [--list second]

`everyday_objects.csv` contains, for each object, the 5, 50 and 95 % quantiles of length, width and height in the usual
pose, in mm. It was written from general knowledge before any prior of release 2.0.0 was computed and has not been
changed since. The author of the table of excluded rows had seen it. `everyday_objects_second.csv` is a second list,
written by a language model on 2026-11-22 at 06:38 without access to the priors of its objects, to the first list or to
the tables of ranges; it has not been changed either.

An axis is *off* if the medians differ by more than a factor of 1.4. It is *absurdly wide* if the prior's 90 % interval
spans more than a factor of six and more than twice the factor of the list.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import options_parser
from metric_base.arrays import FloatArray
from metric_cli.tables import print_table
from metric_tree.axes import AXES, EXTENTS
from metric_tree.node import UnknownName
from metric_tree.prior import Prior
from metric_tree.tiers import TIERS
from metric_tree.tree import Tree, open_tree

LISTS = {
    "first": Path(__file__).with_name("everyday_objects.csv"),
    "second": Path(__file__).with_name("everyday_objects_second.csv"),
}
#: Maximum ratio of the medians.
MAX_MEDIAN_RATIO = 1.4
#: Maximum ratio of the ends of a 90 % interval.
MAX_INTERVAL_RATIO = 6.0


@dataclass(frozen=True, slots=True)
class Axis:
    """5, 50 and 95 % quantiles of an axis of an object in mm, from the list and from the prior."""

    name: str
    node_id: str
    axis: str
    written: tuple[float, float, float]
    prior: tuple[float, float, float]

    @property
    def is_off(self) -> bool:
        """Whether the medians differ by more than a factor of `MAX_MEDIAN_RATIO`."""
        return bool(abs(np.log(self.prior[1] / self.written[1])) > np.log(MAX_MEDIAN_RATIO))

    @property
    def is_wide(self) -> bool:
        """Whether the prior's 90 % interval is absurdly wide."""
        return self.prior[2] / self.prior[0] > max(MAX_INTERVAL_RATIO, 2 * self.written[2] / self.written[0])


def objects(path: Path) -> dict[str, FloatArray]:
    """Read the sizes (3, 3) of each object: rows length, width, height; columns 5, 50, 95 %."""
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    return {row["name"]: np.array([[float(row[f"{a}_{q}"]) for q in ("05", "50", "95")] for a in AXES]) for row in rows}


def axes_of(name: str, written: FloatArray, node_id: str, priors: list[Prior]) -> Iterator[Axis]:
    """Yield the axes of an object that its priors have. Extents are compared with the sorted sizes, longest first."""
    done: set[str] = set()
    for prior in sorted(priors, key=lambda prior: -len(prior.dims)):
        quantiles = np.stack([prior.quantile(q) for q in (0.05, 0.5, 0.95)], axis=1)  # (d, 3)
        for axis, sizes in zip(prior.dims, quantiles, strict=True):
            if axis not in done:
                done.add(axis)
                row = written[AXES.index(axis)] if axis in AXES else -np.sort(-written, axis=0)[EXTENTS.index(axis)]
                yield Axis(name, node_id, axis, tuple(row.tolist()), tuple(sizes.tolist()))


def _measured(tree: Tree, written_sizes: Mapping[str, FloatArray]) -> tuple[list[Axis], list[str]]:
    axes: list[Axis] = []
    unknown: list[str] = []
    for name, written in written_sizes.items():
        try:
            node = tree.find(name)
        except UnknownName:
            unknown.append(name)
            continue
        axes += axes_of(name, written, node.node_id, [node.prior(dims) for dims in node.prior_dims])
    return axes, unknown


def main() -> None:
    """Print the axes with errors, and the percentages of errors."""
    parser = options_parser(__doc__)
    parser.add_argument("release", nargs="?", help="version or folder of a release (default: shipped)")
    parser.add_argument("--list", choices=LISTS, default="first", help="which list (default: %(default)s)")
    arguments = parser.parse_args()
    written = objects(LISTS[arguments.list])
    tree = open_tree(arguments.release)
    axes, unknown = _measured(tree, written)
    print_table(
        ["object", "node", "axis", "written 5/50/95 % mm", "prior 5/50/95 % mm", "error"],
        [
            (
                axis.name,
                axis.node_id,
                axis.axis,
                _sizes(axis.written),
                _sizes(axis.prior),
                " ".join(axis.is_off * ["off"] + axis.is_wide * ["wide"]),
            )
            for axis in sorted(axes, key=lambda axis: axis.name)
            if axis.is_off or axis.is_wide
        ],
    )
    by_tier = {tier: [axis for axis in axes if tree.tier(axis.node_id) == tier] for tier in TIERS}
    print_table(
        ["tier", "axes", "off", "wide"],
        [(tier, len(group), sum(a.is_off for a in group), sum(a.is_wide for a in group))
         for tier, group in by_tier.items()],
    )  # fmt: skip
    off, wide = (np.mean([getattr(axis, name) for axis in axes]) for name in ("is_off", "is_wide"))
    print(
        f"{len(axes)} axes of {len(written) - len(unknown)} objects: {off:.1%} off by more than {MAX_MEDIAN_RATIO}, "
        f"{wide:.1%} absurdly wide"
    )
    print(f"not found: {', '.join(unknown) or 'none'}")


def _sizes(values: tuple[float, float, float]) -> str:
    return " / ".join(f"{value:.3g}" if value < 1000 else f"{value:.0f}" for value in values)


if __name__ == "__main__":
    main()
