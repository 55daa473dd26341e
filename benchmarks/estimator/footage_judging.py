"""Judging of captures by their references, and the tables of the benchmark of real footage.

A case has two results: ours, and that of plain pycolmap on the same frames. An image is placed right if its camera
centre is within 3 % of the extent of the reference's path, after a similarity that is fitted robustly. A model is right
if the root mean square distance of its centres, after the best similarity, is within 3 %, and if the focal length is
within 10 % of that of a constructed error's truth (a straight path fits at any focal length).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from benchmarks.common import row_text, table_head
from benchmarks.estimator.footage_cases import GROUPS, FootageCase, Reference
from metric_base.arrays import FloatArray

__all__ = [
    "Judgement",
    "Row",
    "conditions",
    "gate_table",
    "gates_of",
    "judged",
    "placed_right",
    "summary_rows",
    "table",
]

#: Maximum distance from the reference's path, relative to its extent, of a right image and of a right model.
MAX_PATH_ERROR = 0.03
#: Maximum relative error of the focal length of a right model of a constructed error.
MAX_FOCAL_ERROR = 0.1
#: Minimum number of images that are compared with the reference; a similarity always fits three.
MIN_SHARED = 4
#: Trials of the robust fit. With a third of right images, 300 triples contain one of right images almost surely.
N_TRIALS = 300
COLUMNS = ("placed", "right", "path, % (median)", "CPU, s")


@dataclass(frozen=True, slots=True)
class Judgement:
    """Comparison of a model with its reference."""

    n_placed: int
    n_right: int | None  #: Number of images placed right; None without a reference.
    rms: float | None  #: Root mean square distance of the paths, relative to the extent; None for under four images.
    median: float | None
    is_right: bool | None  #: None if the reference cannot tell.


@dataclass(frozen=True, slots=True)
class Row:
    """A case with both results and their judgements."""

    case: FootageCase
    ours: Mapping[str, Any]
    judgement: Judgement
    plain: Mapping[str, Any] | None = None
    plain_judgement: Judgement | None = None
    reference_focal: float | None = None

    @property
    def is_accepted(self) -> bool:
        """Whether the capture was not refused."""
        return self.ours["code"] is None


def placed_right(centres: FloatArray, reference: FloatArray, extent: float) -> int:
    """Return the number of centres (n, 3) within `MAX_PATH_ERROR` of the reference's, after a robust similarity.

    Similarities are fitted to triples that are drawn with a fixed seed, and then to the centres that the best one
    explains.

    Parameters
    ----------
    centres, reference : (n, 3) ndarray of float
    extent : float
        Root mean square distance of the reference's complete path from its mean.
    """
    n, best = len(centres), 0
    if n < MIN_SHARED:
        return 0
    generator = np.random.default_rng(0)
    for _ in range(N_TRIALS):
        chosen = generator.choice(n, 3, replace=False)
        for _ in range(3):
            is_near = _distances(centres, reference, chosen) <= MAX_PATH_ERROR * extent
            best = max(best, int(is_near.sum()))
            if is_near.sum() < 3:
                break
            chosen = np.flatnonzero(is_near)
    return best


def _distances(centres: FloatArray, reference: FloatArray, chosen: Any) -> FloatArray:
    """Return the distances (n,) of two paths under the similarity of the chosen rows."""
    a, b = centres[chosen], reference[chosen]
    u, d, vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)) / len(a))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    scale = float((d * sign).sum() / max(((a - a.mean(axis=0)) ** 2).sum(axis=1).mean(), 1e-30))
    moved = scale * (centres - a.mean(axis=0)) @ ((u * sign) @ vt).T + b.mean(axis=0)
    return np.asarray(np.linalg.norm(moved - reference, axis=1))


def judged(result: Mapping[str, Any], reference: Reference | None, case: FootageCase) -> Judgement:
    """Return the judgement of a result with the `centres` of its images by name, and its `focal` length."""
    centres: Mapping[str, Any] = result["centres"]
    if case.unusable:
        return Judgement(len(centres), 0, None, None, False if centres else None)
    if reference is None:
        return Judgement(len(centres), None, None, None, None)
    path = np.array(list(reference.centres.values()))
    extent = float(np.sqrt(((path - path.mean(axis=0)) ** 2).sum(axis=1).mean()))
    stems = {name.rpartition(".")[0]: centre for name, centre in centres.items()}
    shared = sorted(stems.keys() & reference.centres.keys())
    if len(shared) < MIN_SHARED or extent == 0:
        return Judgement(len(centres), 0, None, None, None)
    own = np.array([stems[name] for name in shared], dtype=np.float64)
    true = np.array([reference.centres[name] for name in shared])
    distances = _distances(own, true, slice(None))
    part = float(np.sqrt(((true - true.mean(axis=0)) ** 2).sum(axis=1).mean()))  # of the images that are compared
    rms, median = float(np.sqrt((distances**2).mean())) / part, float(np.median(distances)) / part
    is_right = rms <= MAX_PATH_ERROR
    if case.error:
        is_focal = reference.focal is not None and abs(result["focal"] / reference.focal - 1) <= MAX_FOCAL_ERROR
        is_right = is_right and is_focal
    return Judgement(len(centres), placed_right(own, true, extent), rms, median, is_right)


def table(rows: Sequence[Row]) -> str:
    """Return the rows of the cases, ours and plain.

    Cases other than sets are only counted if ours is accepted and right, with as many right images as plain or more,
    and constructed errors if they are refused.
    """
    lines = [table_head(["case", "of", "ours", *COLUMNS, *(f"plain: {name}" for name in COLUMNS)])]
    for group, title in GROUPS.items():
        members = [row for row in rows if row.case.group == group]
        is_clear = _is_refused if group == "error" else _is_as_good
        chosen = [row for row in members if group == "set" or not is_clear(row)]
        if members:
            reason = "that are refused" if group == "error" else "that are right, with no fewer right images than plain"
            more = "" if group == "set" else f", and {len(members) - len(chosen)} {reason}"
            lines.append(row_text([f"**{title}{more}**", *[None] * (2 * len(COLUMNS) + 2)]))
        for row in chosen:
            use = " (chosen on)" if row.case.chosen_on else " (must be refused)" if row.case.unusable else ""
            ours = "accepted" if row.is_accepted else f"`{row.ours['code']}`"
            cells = [f"`{row.case.name}`{use}", row.ours.get("frames"), ours]
            lines.append(row_text([*cells, *_cells(row.ours, row.judgement), *_cells(row.plain, row.plain_judgement)]))
    return "\n".join(lines)


def _is_refused(row: Row) -> bool:
    """Return True if ours is refused."""
    return not row.is_accepted


def _is_as_good(row: Row) -> bool:
    """Return True if ours is accepted and right, and places as many images right as plain, or more."""
    plain_right = (row.plain_judgement.n_right or 0) if row.plain_judgement else None
    return (
        row.is_accepted
        and row.judgement.is_right is True
        and plain_right is not None
        and (row.judgement.n_right or 0) >= plain_right
    )


def _cells(result: Mapping[str, Any] | None, judgement: Judgement | None) -> list[str | None]:
    """Return the cells of `COLUMNS`."""
    if result is None or judgement is None:
        return ["not run", *[None] * (len(COLUMNS) - 1)]
    path = None
    if judgement.rms is not None and judgement.median is not None:
        path = f"{100 * judgement.rms:.1f} ({100 * judgement.median:.1f})"
    right = None if judgement.n_right is None else str(judgement.n_right)
    seconds = None if result.get("cpu_s") is None else f"{result['cpu_s']:.0f}"
    return [str(judgement.n_placed), right, path, seconds]


def summary_rows(rows: Sequence[Row]) -> str:
    """Return a table with a row for each group: the targets of the capture, ours and plain.

    Refused models count if they contain more than half of the frames. Constructed errors have no number of images that
    should be placed.
    """
    head = ["", "cases", "CPU ratio, median", "worst"]
    head += ["fewer placed than plain places right", "right models refused", "refused, and plain is right"]
    lines = [table_head([*head, "wrong models accepted", "plain: wrong models"])]
    for group, title in GROUPS.items():
        chosen = [row for row in rows if row.case.group == group]
        both = [row for row in chosen if row.plain is not None]
        if not chosen:
            continue
        cells: list[object] = [title, len(chosen) if len(both) == len(chosen) else f"{len(chosen)}, plain {len(both)}"]
        ratios = {
            row.case.name: row.ours["cpu_s"] / row.plain["cpu_s"]
            for row in both
            if row.plain is not None and row.ours.get("cpu_s") and row.plain.get("cpu_s")
        }
        worst = max(ratios, key=lambda name: ratios[name], default="")
        cells += [f"{np.median(list(ratios.values())):.2f}", f"{ratios[worst]:.1f} (`{worst}`)"] if ratios else ["", ""]
        is_fewer = [
            row
            for row in both
            if row.plain_judgement is not None
            and not row.case.error
            and (row.judgement.n_placed if row.is_accepted else 0) < (row.plain_judgement.n_right or 0)
        ]
        half = [
            row
            for row in both
            if not row.is_accepted
            and row.plain_judgement is not None
            and row.plain_judgement.is_right
            and 2 * row.plain_judgement.n_placed > row.ours.get("frames", 0)
        ]
        refused = [
            row
            for row in chosen
            if not row.is_accepted and row.judgement.is_right and 2 * row.judgement.n_placed > row.ours.get("frames", 0)
        ]
        wrong = [row for row in chosen if row.is_accepted and row.judgement.is_right is False]
        plain_wrong = [row for row in both if row.plain_judgement and row.plain_judgement.is_right is False]
        cells += [_named(some) for some in (is_fewer, refused, half, wrong, plain_wrong)]
        lines.append(row_text(cells))
    return "\n".join(lines)


def conditions(rows: Sequence[Row], cases: Sequence[FootageCase]) -> str:
    """Return sentences on the versions of the capture, the load of the machine and the cases that were not run."""
    commits = Counter(str(row.ours.get("commit", "unknown")) for row in rows)
    results = [result for row in rows for result in (row.ours, row.plain) if result is not None]
    loads = [result["load"] for result in results if result.get("load") is not None]
    versions = ", ".join(f"{commit} ({count} cases)" for commit, count in commits.most_common())
    lines = [f"Last commit of `capture/` at the time of the run: {versions}."]
    if loads:
        low, middle, high = np.percentile(loads, [0, 50, 100])
        lines.append(f"Load of the machine, which has two cores: {low:.0f} to {high:.0f}, median {middle:.0f}.")
    done = {row.case.name for row in rows}
    for group, title in GROUPS.items():
        members = [case.name for case in cases if case.group == group]
        left = [name for name in members if name not in done]
        if left and len(left) == len(members):
            lines.append(f"{title}: none of {len(members)} was run.")
        elif left:
            names = ", ".join(f"`{name}`" for name in left)
            lines.append(f"{title}: {len(left)} of {len(members)} not run: {names}.")
    return "\n\n".join(lines)


def _named(rows: Sequence[Row], most: int = 6) -> str:
    """Return the number of rows with their names, if they are few."""
    names = ", ".join(f"`{row.case.name}`" for row in rows[:most]) + (", ..." if len(rows) > most else "")
    return f"{len(rows)}: {names}" if rows else "0"


#: Gates of `model_failure` by the figures of the model that they judge.
GATES: dict[str, tuple[str, ...]] = {
    "too few placed": ("names",),
    "parts": ("pieces",),
    "focal length undetermined": ("focal_deviation",),
    "focal lengths across and down": ("aspect",),
    "displacement of the corners": ("lens_bend", "camera"),
    "change of the focal length": ("focal_change", "focal_change_error"),
    "contradicted triplets": ("triplets", "contradicted"),
    "broken frames": ("broken",),
}


def gates_of(metrics: Mapping[str, Any], n_frames: int, held: bool = False) -> set[str]:
    """Return the gates that refuse a model by its figures, each on its own.

    Every gate judges a model whose other figures are beyond doubt, so that one gate does not hide another.

    Parameters
    ----------
    metrics : mapping
        `ModelMetrics` as in `reconstruction.json`.
    n_frames : int
        Number of frames of the capture.
    held : bool
        Whether the focal length was not refined.
    """
    from capture.mapping.match_graph import MatchGraph
    from capture.mapping.model_metrics import ModelMetrics
    from capture.mapping.refusals import model_failure

    model = msgspec.convert(metrics, ModelMetrics)
    frames = [f"{index:06d}.jpg" for index in range(n_frames)]
    graph = MatchGraph(frames, np.full(n_frames, 1000), (), (1000, 750), np.full((n_frames, 2), 0.3))
    sound = ModelMetrics(
        names=tuple(frames), points=1000, error_px=0.5, focal=0.8, lens_bend=0.0,
        camera="SIMPLE_RADIAL", focal_deviation=0.001, triplets=100, pieces=(n_frames,),
    )  # fmt: skip
    fired = set()
    for gate, fields in GATES.items():
        changed = msgspec.structs.replace(sound, **{name: getattr(model, name) for name in fields})
        if model_failure(graph, changed, held) is not None:
            fired.add(gate)
    return fired


def gate_table(rows: Sequence[Row]) -> str:
    """Return the rates of the gates that refuse models: how many right and wrong ones of each kind.

    Models are ours, accepted or refused, and those of plain pycolmap, whose gates are known. A model of a constructed
    error that is right does not hold the error.
    """
    counts = {gate: [0] * 6 for gate in ("models", *GATES)}
    for row in rows:
        pairs = [(0, row.ours, row.judgement), (1, row.plain, row.plain_judgement)]
        for source, result, judgement in pairs:
            if result is None or judgement is None or judgement.is_right is None or result.get("gates") is None:
                continue
            column = (2 if row.case.error else source) + (0 if judgement.is_right else 3)
            for gate in ("models", *result["gates"]):
                counts[gate][column] += 1
    head = [
        "right, ours",
        "right, plain",
        "constructed error, right",
        "wrong, ours",
        "wrong, plain",
        "constructed error, wrong",
    ]
    lines = [table_head(["gate", *head])]
    lines += [row_text([gate, *row]) for gate, row in counts.items() if gate == "models" or any(row)]
    lines += ["", "All other gates refused none."]
    codes: dict[str, dict[str, int]] = {}
    kinds = sorted({row.case.error for row in rows if row.case.error})
    for row in rows:
        if row.case.error:
            outcome = row.ours["code"] or ("accepted, right" if row.judgement.is_right else "accepted, wrong")
            codes.setdefault(row.case.error, {}).setdefault(outcome, 0)
            codes[row.case.error][outcome] += 1
    lines += ["", table_head(["constructed error", "outcome"])]
    for kind in kinds:
        outcomes = sorted(codes[kind].items())
        lines.append(row_text([kind, ", ".join(f"{count} {_code(outcome)}" for outcome, count in outcomes)]))
    return "\n".join(lines)


def _code(outcome: str) -> str:
    return outcome if outcome.startswith("accepted") else f"`{outcome}`"
