"""What the geometry costs and how well it measures, on synthetic scenes.

`python -m benchmarks.estimator.geometry [PART ...]`.

Parts: `times` (labels per frame, dimensions per scene; the paper: 200 ms and 20 ms), `bottle` (the paper's figure of
three cases), `extents` (bias of the one extent rule by points and noise), `noise` (what is read of
it in pictures), `overshoot` (what it adds to extents), `rooms` (synthetic rooms: association, sizes, supports).
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter, process_time

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.association.point_labels import dense_labels, sparse_labels, view_labels, visible_rows
from estimator.geometry.eta import eta
from estimator.geometry.extents import edges
from estimator.geometry.footprint import smallest_rectangle_axes
from estimator.geometry.measurement import PAPER, MeasurementOptions, measure_objects
from estimator.geometry.noise import depth_noise
from estimator.geometry.upright_box import dimensions, inliers
from estimator.records.measured_object import ETA_THRESHOLD
from metric_base.arrays import FloatArray
from tests.synthetic.shapes import Solid, Thing, box, floor, orbit, sampled_box, sampled_cylinder, synthetic_scene

__all__ = ["bottle_confidences", "main"]

REPEATS = 20
#: The figure of the three cases in the paper, for comparison.
PAPER_BOTTLE = {0: (0.912, 1.077, 0.926), 30: (0.885, 1.001, 0.543), 45: (0.593, 1.045, 0.291)}


def milliseconds(work: Callable[[], object]) -> str:
    """Median time of a call after one to warm up, by the clock and by the processor: they differ on a busy machine."""
    work()
    clock, processor = [], []
    for _ in range(REPEATS):
        started, used = perf_counter(), process_time()
        work()
        clock.append((perf_counter() - started) * 1e3)
        processor.append((process_time() - used) * 1e3)
    return f"{np.median(clock):.1f} ms ({np.median(processor):.1f} ms of processor time, least {min(processor):.1f})"


def bottle_confidences(degrees: float, points: int = 4000, seed: int = 0) -> FloatArray:
    """(3,) eta of a made bottle that leans by so many degrees, by the paper's own minimum rectangle."""
    lean = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    body, neck = np.array([0.08, 0.08, 0.22]), np.array([0.03, 0.03, 0.08])
    solids = (
        Solid("cylinder", body, lean @ np.array([0, 0, 0.0]), lean),
        Solid("cylinder", neck, lean @ np.array([0, 0, 0.15]), lean),
    )
    views = orbit(12, 0.9, 0.45, target=(0, 0, 0.03), size=(240, 180), focal=220.0)
    cloud = synthetic_scene([Thing("bottle", solids)], views, dense=points, noise=0.001, seed=seed).scene.dense
    assert cloud is not None
    axes = np.eye(3)
    axes[:2, :2] = smallest_rectangle_axes(cloud.points[:, :2])
    local = cloud.points @ axes.T
    return eta(local, local.min(axis=0), local.max(axis=0))


def times() -> None:
    """Labels per frame with 100,000 points and 10 masks; dimensions per scene with 20 objects of 1,000 points."""
    things = [floor()]
    things += [
        box("chair", (0.5, 0.4, 0.9), (1.2 * np.cos(a), 1.2 * np.sin(a), 0), 30 * a) for a in np.arange(10) * 0.628
    ]
    made = synthetic_scene(things, orbit(6, 3.5, 1.6), dense=100_000)
    view, cloud = made.scene.views[0], made.scene.dense
    assert cloud is not None
    masks = [instance for instance in made.instances if instance.view == 0]

    def labels() -> object:
        _, pixels = visible_rows(view, cloud.points)
        return view_labels(pixels, masks)

    print(f"labels: {len(cloud.points)} points, {len(masks)} masks, a frame: {milliseconds(labels)}")
    random = np.random.default_rng(0)
    clouds = [
        (sampled_box if k % 2 else sampled_cylinder)(random.uniform(0.1, 1.0, 3), 1000, random)
        + random.normal(0, 0.003, (1000, 3))
        for k in range(20)
    ]
    basis = np.eye(3)

    def sizes() -> object:
        kept = [inliers(cloud, basis, "neighbours") for cloud in clouds]
        return [dimensions(one, basis, 0.003**2 * np.eye(3)) for one in kept]

    print(f"dimensions: {len(clouds)} objects of 1000 points, a scene: {milliseconds(sizes)}")
    start = perf_counter()
    for points in clouds:
        inliers(points, basis, "forest")
    print(f"isolation forest of the paper's arm: {(perf_counter() - start) * 1e3:.0f} ms a scene more")
    measurements = measure_objects(made.scene, made.instances)
    stages = ", ".join(f"{stage} {seconds * 1e3:.0f}" for stage, seconds in measurements.timings.items())
    print(f"the whole of it, {len(made.scene.views)} views of 100,000 points, in ms: {stages}")


def bottle() -> None:
    """The paper's figure of three cases beside ours."""
    print(f"bottle: eta of x, y, z (threshold {ETA_THRESHOLD})")
    for degrees, paper in PAPER_BOTTLE.items():
        ours = np.mean([bottle_confidences(degrees, seed=seed) for seed in range(5)], axis=0)
        print(f"  {degrees:2d} degrees: ours {np.round(ours, 3)}, paper {paper}")


def extents() -> None:
    """Bias and spread of the extent rule on synthetic shapes, in log size."""
    random = np.random.default_rng(0)
    shapes = {"box": sampled_box, "cylinder": sampled_cylinder}
    print("extents: mean (spread) of log measured / true over random sizes, by noise as a share of the longest side")
    for count in (30, 100, 400, 1000, 4000):
        for noise in (0.0, 0.003, 0.01):
            errors = []
            for shape in shapes.values():
                for _ in range(30):
                    size = random.uniform(0.3, 1.0, 3)
                    size[1] = size[0]
                    points = shape(size, count, random) + random.normal(0, noise * size.max(), (count, 3))
                    low, high = edges(points, noise * size.max())
                    errors.append(np.log((high - low) / size))
            print(f"  {count:5d} points, noise {noise:.3f}: {np.mean(errors):+.3f} ({np.std(errors):.3f})")


def overshoot() -> None:
    """How far the extent rule puts an edge outside a surface with noise, in standard deviations of the noise."""
    random = np.random.default_rng(0)
    print("overshoot: mean over 60 clouds of 1000 points, by noise over extent and share of points on either face")
    for noise in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0):
        cells = []
        for face in (0.0, 0.17, 0.33):
            observed = [_observed_extent(face, noise, random) for _ in range(60)]
            cells.append(f"{face:.2f}: {(np.mean(observed) - 1) / 2 / noise:.2f}")
        print(f"  noise {noise:.2f}: {', '.join(cells)}")


def _observed_extent(face: float, noise: float, random: np.random.Generator) -> float:
    """Extent that the rule gives to one coordinate of a surface of extent 1, `face` of its points on either end."""
    which, inner = random.random(1000), random.random(1000)
    clean = np.where(which < face, 0.0, np.where(which < 2 * face, 1.0, inner))
    low, high = edges((clean + random.normal(0, noise, 1000))[:, None])
    return float(high[0] - low[0])


def noise(seed: int = 1000) -> None:
    """The depth noise that is read in the pictures over the true one, in quick rooms; dense and sparse points."""
    from tests.synthetic.rooms.furnish import furnished_room
    from tests.synthetic.rooms.kinds import KINDS
    from tests.synthetic.rooms.knobs import Knobs
    from tests.synthetic.rooms.quick import quick_scene

    for share in (0.002, 0.004, 0.01, 0.03):
        knobs = Knobs(depth_noise=share)
        cells = []
        for kind in KINDS:
            made = quick_scene(furnished_room(kind, seed, knobs=knobs), knobs, seed)
            clouds = dense_labels(made.scene, made.instances), sparse_labels(made.scene, made.instances)
            cells.append(", ".join(f"{depth_noise(made.scene.views, cloud) / share:.2f}" for cloud in clouds))
        print(f"noise {share:.3f}: {'; '.join(cells)}")


def rooms(seeds: tuple[int, ...] = (101, 102)) -> None:
    """Synthetic rooms with exact truth: association of both kinds, sizes with and without supports."""
    from tests.synthetic.rooms.furnish import furnished_room
    from tests.synthetic.rooms.kinds import KINDS
    from tests.synthetic.rooms.knobs import Knobs
    from tests.synthetic.rooms.quick import quick_scene

    knobs = Knobs(missing_feet=0.3)
    scenes = [quick_scene(furnished_room(kind, seed, knobs), knobs, seed) for kind in KINDS for seed in seeds]
    arms = {
        "default": (MeasurementOptions(), True),
        "without supports": (MeasurementOptions(supports=False), True),
        "repaired Algorithm 1": (MeasurementOptions(association="incremental"), True),
        "paper": (PAPER, True),
        "default, sparse points": (MeasurementOptions(), False),
        "repaired Algorithm 1, sparse points": (MeasurementOptions(association="incremental"), False),
    }
    print(f"rooms: {len(scenes)} rooms, 30 % of the objects without a foot; log error of sizes no flag calls cut")
    for name, (options, dense) in arms.items():
        _report(name, scenes, options, dense)


def _report(name: str, scenes: list, options: MeasurementOptions, dense: bool) -> None:  # type: ignore[type-arg]
    from sklearn.metrics import adjusted_rand_score

    errors, index, splits, merges = [], [], 0, 0
    for made in scenes:
        scene = made.scene if dense else replace(made.scene, dense=None)
        measurements = measure_objects(scene, made.instances, options)
        true = [instance.track for instance in made.instances]
        given = np.zeros(len(true), dtype=int)
        for number, track in enumerate(measurements.tracks):
            given[list(track.members)] = number
        index.append(adjusted_rand_score(true, given))
        splits += sum(len(set(given[[t == one for t in true]])) - 1 for one in set(true))
        merges += sum(len({true[row] for row in track.members}) - 1 for track in measurements.tracks)
        for thing in measurements.objects:
            if thing.skipped is None:
                owner = Counter(true[row] for row in thing.members).most_common(1)[0][0]
                error = np.log(thing.extents * made.truth.metres_per_unit / made.truth.objects[owner].size)
                errors.append(np.where(thing.truncated, np.nan, error))
    sizes = []
    for axis, column in zip(("length", "width", "height"), np.array(errors).T, strict=True):
        free = column[np.isfinite(column)]
        within = f"|e| {np.median(np.abs(free)):.3f}, 90 % under {np.quantile(np.abs(free), 0.9):.3f}, n {free.size}"
        sizes.append(f"{axis} {np.median(free):+.3f} ({within})")
    print(f"  {name}: ARI {np.mean(index):.4f}, splits {splits}, merges {merges}; {', '.join(sizes)}")


PARTS = {"times": times, "bottle": bottle, "extents": extents, "noise": noise, "overshoot": overshoot, "rooms": rooms}


def main(words: list[str]) -> None:
    for part in words or list(PARTS):
        PARTS[part]()


if __name__ == "__main__":
    main(sys.argv[1:])
