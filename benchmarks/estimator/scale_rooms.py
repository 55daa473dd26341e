"""Scale on synthetic rooms: twenty end to end through pycolmap, and sweeps of every knob on quick ones.

    python -m benchmarks.estimator.scale_rooms --raw RAW --cache DIR [--sweep NAME ...] [--seeds 0 1 2 3] [--json FILE]

RAW holds raw items (`metric-tree import`). One fold of them is kept from the tree, and the rooms' true sizes are
drawn from that fold alone. Reported seeds are 0 to 3 of each kind; whoever tunes anything uses seeds from 1000 on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from estimator.association.point_labels import sparse_labels
from estimator.association.tracks import incremental_tracks, shared_tracks
from estimator.reading import read_instances, read_scene
from metric_tree.build.steps import Options as BuildOptions
from metric_tree.build.steps import build_release, shipped_taxonomy
from metric_tree.tree import Tree, open_tree
from tests.synthetic.rooms.arms import ARMS, AUTHORS, Case, scores
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.held_out import held_out_pool, pool_at
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.reconstruct import NotReconstructed, reconstruct
from tests.synthetic.rooms.scores import Score, association_score, summary
from tests.synthetic.rooms.sizes import Sizes, drawn_sizes
from tests.synthetic.rooms.street import street
from tests.synthetic.rooms.truth import truth_at
from tests.synthetic.rooms.world import World

#: One fifth of the items is kept from the tree.
FOLD = (0, 5)
#: Seeds of the quick scenes in the sweeps, per kind.
SWEEP_SEEDS = (100, 101)

#: Points in a mask from which its association is also scored apart.
MASK_POINTS = 5

SWEEPS: dict[str, list[tuple[str, Knobs]]] = {
    "objects": [(f"objects: {n}", Knobs(objects=n)) for n in (1, 3, 6, 12, 20)],
    "coverage": [(f"{share:.0%} of the walk", Knobs(coverage=share)) for share in (1.0, 0.4, 0.15)],
    "mislabelled": [(f"{share:.0%} mislabelled", Knobs(mislabelled=share)) for share in (0.1, 0.25, 0.5)],
    "noise": [(f"depth noise {share:.1%}", Knobs(depth_noise=share)) for share in (0.01, 0.03)],
    "tilt": [(f"{share:.0%} tilted by 30 deg", Knobs(tilted=share, tilt_deg=30)) for share in (0.25, 1.0)],
    "feet": [(f"{share:.0%} without feet", Knobs(missing_feet=share)) for share in (0.5, 1.0)],
    "turn": [(f"turn of {deg} deg", Knobs(turn_deg=deg)) for deg in (20, 5, 2)],
    "street": [("street", Knobs())],
}


def main() -> None:
    arguments = _arguments()
    tree, sizes = _tree_and_sizes(arguments.raw, arguments.cache)
    rows: list[Score] = []
    if arguments.sweep:
        for name in arguments.sweep:
            for label, knobs in SWEEPS[name]:
                rows += _report(label, _quick_cases(name, knobs, sizes, arguments.sweep_seeds), tree, arguments)
    else:
        cases = list(_whole_cases(arguments.cache, sizes, arguments.seeds))
        rows += _report(f"{len(cases)} rooms end to end (pycolmap)", cases, tree, arguments)
        _report_association(cases)
    if arguments.json:
        arguments.json.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--raw", type=Path, required=True, help="folder of raw items")
    parser.add_argument("--cache", type=Path, default=Path("/tmp/scale_rooms"), help="reconstructions, tree and sizes")  # noqa: S108
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3], help="rooms of each kind")
    parser.add_argument("--sweep", nargs="+", choices=SWEEPS, help="knobs to turn on quick rooms")
    parser.add_argument("--sweep-seeds", type=int, nargs="+", default=list(SWEEP_SEEDS))
    parser.add_argument("--lists", type=Path, help="the authors' lists (scale_metrics), for one more arm of the paper")
    parser.add_argument(
        "--arms", nargs="+", choices=ARMS, help="all by default, but the authors' lists without --lists"
    )
    parser.add_argument("--json", type=Path, help="every score, one line each")
    arguments = parser.parse_args()
    if arguments.arms is None:
        arguments.arms = [arm for arm in ARMS if arm != AUTHORS or arguments.lists]
    return arguments


def _tree_and_sizes(raw: Path, cache: Path) -> tuple[Tree, Sizes]:
    """The tree without the fold, and sizes drawn from the fold; both are kept in the cache."""
    files = [path for path in sorted(raw.glob("*.jsonl*")) if "quarantine" not in path.name]
    out = cache / "tree"
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        build_release(
            files, out, BuildOptions(version="0.0.0", created="2026-11-21", name="rooms", fold_out=FOLD, heldout=False)
        )
    tree = open_tree(out)
    pool = pool_at(cache / "sizes.json", partial(held_out_pool, files, tree, shipped_taxonomy, FOLD))
    return tree, drawn_sizes(pool)


def _whole_cases(cache: Path, sizes: Sizes, seeds: Sequence[int]) -> Iterator[Case]:
    """Rooms through pycolmap, made where the cache has none; one that pycolmap cannot place is named and left out."""
    for kind in KINDS:
        for seed in seeds:
            world = furnished_room(kind, seed, sizes=sizes)
            folder = cache / "scenes" / f"{kind.replace(' ', '_')}-{seed}"
            if not (folder / "truth.json").exists():
                try:
                    reconstruct(world, folder, seed)
                except NotReconstructed as failure:
                    print(f"left out: {failure}", file=sys.stderr)
                    continue
            scene = read_scene(folder)
            yield Case(f"{kind} {seed}", scene, tuple(read_instances(None, scene)), truth_at(folder, world))


def _quick_cases(sweep: str, knobs: Knobs, sizes: Sizes, seeds: Sequence[int]) -> Iterator[Case]:
    makers: list[tuple[str, Callable[[int], World]]] = [
        (kind, partial(furnished_room, kind, knobs=knobs, sizes=sizes)) for kind in KINDS
    ]
    if sweep == "street":
        makers = [("street", partial(street, knobs=knobs, sizes=sizes))] * len(KINDS)
        seeds = range(seeds[0], seeds[0] + len(seeds))
    for number, (kind, maker) in enumerate(makers):
        for seed in seeds:
            own = seed + 1000 * number if sweep == "street" else seed
            made = quick_scene(maker(own), knobs, own)
            yield Case(f"{kind} {own}", made.scene, made.instances, made.truth)


def _report(title: str, cases: Iterable[Case], tree: Tree, arguments: argparse.Namespace) -> list[Score]:
    """Judge every case by every arm and print one table."""
    rows: list[Score] = []
    for case in cases:
        by_arm = scores(case, tree, arguments.arms, arguments.lists)
        rows += [score for score, _, _ in by_arm.values()]
        print(case.name, {arm: _percent(score.signed) for arm, (score, _, _) in by_arm.items()}, file=sys.stderr)
    print(f"\n### {title}\n")
    columns = (
        "method", "scenes", "refused", "scale error median", "mean", "90th pct", "bias",
        "height error median", "mean +/- sd", "90th pct", "coverage of 90 %", "high/low",
    )  # fmt: skip
    _print_row(columns)
    _print_row(["---"] * len(columns))
    for arm in arguments.arms:
        s = summary([row for row in rows if row.method == arm])
        heights = (f"{s.heights_median:.3f}", f"{s.heights_mean:.3f} +/- {s.heights_sd:.3f}", f"{s.heights_p90:.3f}")
        scale = (f"{s.median:.3f}", f"{s.mean:.3f}", f"{s.p90:.3f}", f"{s.bias:+.3f}")
        _print_row([arm, str(s.scenes), f"{s.refused:.0%}", *scale, *heights, f"{s.coverage:.2f}", f"{s.ratio:.2f}"])
    return rows


def _print_row(cells: Sequence[str]) -> None:
    print(f"| {' | '.join(cells)} |")


def _percent(value: float | None) -> str:
    return "refused" if value is None else f"{value:+.3f}"


def _report_association(cases: Sequence[Case]) -> None:
    """Both associations on the same masks and labels, by name of the true objects.

    A mask without points of its own can be joined to nothing by any rule, so the masks that have some are scored apart.
    """
    print("\n### Association\n")
    _print_row(["association", "masks", "adjusted Rand index mean", "least", "splits", "merges", "objects"])
    _print_row(["---"] * 7)
    by_arm: dict[tuple[str, str], list[tuple[float, int, int, int]]] = {}
    for case in cases:
        labels = sparse_labels(case.scene, case.instances)
        pointed = [bool(n >= MASK_POINTS) for n in labels.membership.sum(axis=1)]
        for name, tracks in (
            ("shared tracks", shared_tracks(case.instances, [labels])),
            ("Algorithm 1, repaired", incremental_tracks(case.instances, labels)),
        ):
            for masks, among in (("all", None), (f"with {MASK_POINTS} points or more", pointed)):
                s = association_score(case.instances, tracks, among)
                by_arm.setdefault((name, masks), []).append((s.ari, s.splits, s.merges, s.objects))
    for (name, masks), rows in by_arm.items():
        ari, splits, merges, objects = zip(*rows, strict=True)
        counts = [str(sum(values)) for values in (splits, merges, objects)]
        _print_row([name, masks, f"{sum(ari) / len(ari):.4f}", f"{min(ari):.4f}", *counts])


if __name__ == "__main__":
    main()
