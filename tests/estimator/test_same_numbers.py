"""Estimates of fixed scenes have the numbers that they had: a change of a rule or weight shows which results move.

`python -m tests.estimator.test_same_numbers` writes the file again if a change is intended.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import metric_tree
from estimator import EstimateOptions, Instance, Scene, SceneEstimate, estimate_scene, read_instances, read_scene
from estimator.pipeline import measure_objects
from estimator.records.scene import DenseCloud, InstanceSet
from tests.support.same_numbers import assert_equal_numbers, rounded, write_numbers
from tests.synthetic.evidence import KINDS, RIG_M
from tests.synthetic.shapes import Shape, Solid, box, cylinder, ellipsoid, floor, orbit, synthetic_scene, yaw
from tests.synthetic.walk import synthetic_walk, with_rig

DEMO = Path(__file__).resolve().parents[2] / "data" / "scenes" / "demo_room"
NUMBERS = Path(__file__).with_name("same_numbers.json")
#: Cameras around the middle of the room: complete views, and a half circle that is close and cuts objects off.
FAR = orbit(10, 2.9, 1.7, arc=330, target=(0.1, 0.1, 0.5), size=(240, 180), focal=170.0)  # type: ignore[arg-type]
NEAR = orbit(8, 1.7, 1.3, arc=150, target=(0.2, 0.2, 0.5), size=(240, 180), focal=210.0)  # type: ignore[arg-type]


def furniture() -> list[Shape]:
    """Objects that stand, lie on others, hang, lean, and stand close to one another."""
    leaning = Solid("box", np.array([0.3, 0.04, 0.45]), np.array([-1.2, 0.9, 0.24]), yaw(20))
    legs = [Solid("box", np.array([0.05, 0.05, 0.7]), np.array([x, y, 0.35])) for x in (-0.6, 0.6) for y in (-0.3, 0.5)]
    top = Solid("box", np.array([1.3, 0.9, 0.04]), np.array([0.0, 0.1, 0.72]))
    return [
        floor(6),
        box(None, (6, 0.1, 2.4), (0, 2.4, 0)),
        Shape("dining table", (top, *legs)),
        cylinder("bottle", (0.08, 0.08, 0.28), (0.1, 0.1, 0.74)),
        cylinder("cup", (0.09, 0.09, 0.1), (-0.35, 0.0, 0.74)),
        box("chair", (0.45, 0.45, 0.85), (1.0, -0.5, 0), 40),
        box("chair", (0.45, 0.45, 0.85), (1.5, -0.3, 0), 55),
        box("couch", (1.9, 0.9, 0.8), (-1.7, -0.6, 0), 80),
        ellipsoid("potted plant", (0.4, 0.4, 0.7), (1.5, 1.3, 0)),
        Shape("suitcase", (leaning,)),
        box("tv", (1.0, 0.07, 0.6), (0.6, 2.3, 1.0)),
        box("sink", (0.5, 0.4, 0.2), (-0.6, 2.1, 0.7)),
    ]


def shapes(views: list[Any], sparse: int, dense: bool, seed: int) -> tuple[Scene, tuple[Instance, ...]]:
    """The furniture with 2 % stray points and masks of unequal scores; the cup has a second mask in some images."""
    made = synthetic_scene(furniture(), views, dense=24_000, noise=0.004, sparse=sparse, seed=seed)
    generator = np.random.default_rng(seed)
    assert made.scene.dense is not None
    cloud = made.scene.dense.points
    stray = generator.uniform(cloud.min(axis=0), cloud.max(axis=0), (len(cloud) // 50, 3))
    scores = generator.uniform(0.6, 1.0, len(made.instances))
    instances = [
        replace(one, score=float(score), track=None) for one, score in zip(made.instances, scores, strict=True)
    ]
    instances += [replace(one, id=f"again-{one.id}", score=0.5) for one in instances if one.category == "cup"][:3]
    scene = replace(made.scene, dense=DenseCloud(np.concatenate([cloud, stray])) if dense else None)
    return scene, tuple(instances)


def boxes(instances: tuple[Instance, ...]) -> tuple[Instance, ...]:
    """The masks as the rectangles around them."""
    return tuple(replace(one, mask=np.ones_like(one.mask), from_box=True) for one in instances)


def estimate(name: str) -> SceneEstimate:
    """The estimate of a named scene."""
    options = EstimateOptions(leave_one_class_out=True)
    if name.startswith("demo room"):
        scene = read_scene(DEMO)
        instances = tuple(read_instances(DEMO / "instances.json", scene))
    else:
        scene, instances = shapes(
            NEAR if "near" in name else FAR, 2500 if "many" in name else 700, "dense" in name, seed=3
        )
    if "boxes" in name:
        instances = boxes(instances)
    for method in ("height", "sucar"):
        if method in name:
            options = EstimateOptions(method=method)
    return estimate_scene(scene, metric_tree.open(), options, instances=InstanceSet(instances))


SCENES = (
    "demo room",
    "demo room, boxes",
    "shapes, far, dense",
    "shapes, near, dense, boxes",
    "shapes, near, many points",
    "shapes, far, few points",
    "shapes, far, dense, height",
    "shapes, far, dense, sucar",
)


def numbers_of(found: SceneEstimate) -> dict[str, list[float]]:
    """Scale, modes and suggestions, and for each object its sizes, their errors and its weight."""
    result, measured = found.result, found.measurements
    interval = [] if result.interval is None else [result.interval.low, result.interval.high]
    numbers: dict[str, list[float]] = {
        "scale": [result.scale or 0.0, *interval],
        "modes": [value for mode in result.modes for value in (mode.scale, mode.mass)],
        "without": [one.scale or 0.0 for one in result.leave_one_class_out or ()],
        "counts": [len(result.warnings), len(result.would_help), len(result.objects)],
    }
    for report in result.objects:
        numbers[f"{report.category} {report.id}"] = [
            report.scale or 0.0, report.weight, report.views, report.points, len(report.notes), len(report.used),
            len(report.truncated), *report.dimensions.values(), *(report.confidence or {}).values(),
        ]  # fmt: skip
    for one in measured.objects if measured else ():
        numbers[f"sigma {one.id}"] = (
            [*np.nan_to_num(one.sigma), *np.ravel(np.nan_to_num(one.covariance))]
            if (one.covariance is not None)
            else [*np.nan_to_num(one.sigma)]
        )
    if measured:
        numbers["vertical"] = [*measured.up.vector, measured.up.sigma_deg]
        numbers["planes"] = [value for plane in measured.planes for value in (plane.height, plane.sigma, plane.points)]
    return {key: rounded(row) for key, row in numbers.items()}


def evidence_numbers(folder: Path) -> dict[str, list[float]]:
    """Value and error of each kind of evidence along a walk."""
    walk = with_rig(synthetic_walk(folder, views=8), RIG_M)
    measured = measure_objects(walk.scene, ())
    rows = {name: case.rows(walk, measured) for name, case in KINDS.items()}
    return {
        name: rounded(v for row in found for v in (row.scale or 0, row.sd_log or 0, row.doubt))
        for name, found in rows.items()
    }


@pytest.mark.parametrize("name", SCENES)
def test_an_estimate_has_the_numbers_that_it_had(name: str) -> None:
    assert_equal_numbers(numbers_of(estimate(name)), json.loads(NUMBERS.read_text())[name])


def test_evidence_has_the_numbers_that_it_had(tmp_path: Path) -> None:
    assert_equal_numbers(evidence_numbers(tmp_path), json.loads(NUMBERS.read_text())["evidence"])


def main() -> None:
    """Write the numbers of now."""
    import tempfile

    found = {name: numbers_of(estimate(name)) for name in SCENES}
    with tempfile.TemporaryDirectory() as made:
        found["evidence"] = evidence_numbers(Path(made))
    write_numbers(NUMBERS, found)


if __name__ == "__main__":
    main()
