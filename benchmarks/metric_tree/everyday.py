"""How the priors of a hundred everyday objects compare with sizes that were written down before looking.

`everyday_objects.csv` holds, for each object, sizes that 5, 50 and 95 % of such objects do not exceed, in mm by length,
width and height in the ordinary pose. It was written from general knowledge before any prior of release 2.0.0 was
computed, and is not changed afterwards. Who wrote the table of excluded rows had seen it. `everyday_objects_second.csv`
is a fresh one: a language model wrote it on 2026-11-22 at 06:38, before it had seen a prior of its objects, the first
list or the tables of ranges; it too is not changed.

    python -m benchmarks.metric_tree.everyday [RELEASE] [--list second]

An axis is off where the prior's median differs from the written one by more than 1.4. It is absurdly wide where the
prior's 90 % interval spans more than a factor of six and more than twice the written factor.
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
OFF, WIDE = 1.4, 6.0


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of one object: written and prior sizes in mm at 5, 50 and 95 %."""

    name: str
    node_id: str
    axis: str
    written: tuple[float, float, float]
    prior: tuple[float, float, float]

    @property
    def is_off(self) -> bool:
        """Whether the medians differ by more than `OFF`."""
        return bool(abs(np.log(self.prior[1] / self.written[1])) > np.log(OFF))

    @property
    def is_wide(self) -> bool:
        """Whether the prior's 90 % interval is absurdly wide."""
        return self.prior[2] / self.prior[0] > max(WIDE, 2 * self.written[2] / self.written[0])


def objects(path: Path) -> dict[str, FloatArray]:
    """Written sizes (3, 3) of each object: a row for length, width, height; columns 5, 50, 95 %."""
    with path.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    return {row["name"]: np.array([[float(row[f"{a}_{q}"]) for q in ("05", "50", "95")] for a in AXES]) for row in rows}


def axes_of(name: str, written: FloatArray, node_id: str, priors: list[Prior]) -> Iterator[Axis]:
    """The axes of an object that its priors have; extents are compared with the written sizes, longest first."""
    done: set[str] = set()
    for prior in sorted(priors, key=lambda one: -len(one.dims)):
        quantiles = np.stack([prior.quantile(q) for q in (0.05, 0.5, 0.95)], axis=1)  # (d, 3)
        for axis, sizes in zip(prior.dims, quantiles, strict=True):
            if axis not in done:
                done.add(axis)
                own = written[AXES.index(axis)] if axis in AXES else -np.sort(-written, axis=0)[EXTENTS.index(axis)]
                yield Axis(name, node_id, axis, tuple(own.tolist()), tuple(sizes.tolist()))


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
    """Print the shares and the axes in error."""
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
                one.name,
                one.node_id,
                one.axis,
                _sizes(one.written),
                _sizes(one.prior),
                " ".join(one.is_off * ["off"] + one.is_wide * ["wide"]),
            )
            for one in sorted(axes, key=lambda one: one.name)
            if one.is_off or one.is_wide
        ],
    )
    by_tier = {tier: [one for one in axes if tree.tier(one.node_id) == tier] for tier in TIERS}
    print_table(
        ["tier", "axes", "off", "wide"],
        [(t, len(own), sum(a.is_off for a in own), sum(a.is_wide for a in own)) for t, own in by_tier.items()],
    )
    off, wide = (np.mean([getattr(one, name) for one in axes]) for name in ("is_off", "is_wide"))
    print(
        f"{len(axes)} axes of {len(written) - len(unknown)} objects: {off:.1%} off by {OFF}, {wide:.1%} absurdly wide"
    )
    print(f"not found: {', '.join(unknown) or 'none'}")


def _sizes(values: tuple[float, float, float]) -> str:
    return " / ".join(f"{value:.3g}" if value < 1000 else f"{value:.0f}" for value in values)


if __name__ == "__main__":
    main()
