"""Plain pycolmap on a folder of images: `python -m benchmarks.estimator.plain_colmap IMAGES OUT`.

Default options of every step: SIFT, exhaustive matching, the incremental mapper, one camera of the model SIMPLE_RADIAL.
Only the seeds of the verification and of the mapper are fixed (0); COLMAP takes a random one. The largest model is
written to `OUT/sparse`, and one line of JSON to standard output: the number of images, the camera centres of the placed
ones, the focal length relative to the longer side, wall and processor seconds, the load of the machine, and our figures
of the model, by which the gates of the capture are judged. The figures are computed after the time is taken.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

from estimator.reconstructions.pycolmap_library import pycolmap


def main(images: Path, out: Path) -> None:
    """Reconstruct the images of a folder."""
    from capture.mapping.worker import processor_s

    pycolmap.logging.minloglevel = 2
    (out / "models").mkdir(parents=True)
    (out / "sparse").mkdir()
    started, cpu = time.perf_counter(), processor_s()
    database = out / "database.db"
    reader = pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL")
    pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = 0
    pycolmap.match_exhaustive(database, verification_options=verification)
    options = pycolmap.IncrementalPipelineOptions(random_seed=0)
    models = pycolmap.incremental_mapping(database, images, out / "models", options=options)
    times = {"wall_s": round(time.perf_counter() - started, 1), "cpu_s": round(processor_s() - cpu, 1)}
    times["load"] = round(os.getloadavg()[0], 1)  # of the last minute
    with pycolmap.Database.open(database) as opened:
        n_images = opened.num_images()
    result: dict[str, Any] = {"frames": n_images, "placed": 0, "centres": {}, "focal": None, "metrics": None}
    model = max(models.values(), key=lambda one: one.num_reg_images(), default=None)
    if model is not None:
        model.write_binary(str(out / "sparse"))
        result |= camera_path(out / "sparse") | {"metrics": _metrics(out / "sparse", database)}
    print(json.dumps(result | times))


def camera_path(folder: Path) -> dict[str, Any]:
    """Return the number of placed images, their centres by name, and the focal length of the first camera of a model.

    The focal length is relative to the longer side of the image.
    """
    model = pycolmap.Reconstruction(folder)
    camera = min(model.cameras.items())[1]
    placed = sorted((image for image in model.images.values() if image.has_pose), key=lambda image: image.name)
    return {
        "placed": len(placed),
        "centres": {image.name: [round(float(x), 6) for x in image.projection_center()] for image in placed},
        "focal": round(float(camera.params[0]) / max(camera.width, camera.height), 4),
    }


def _metrics(folder: Path, database: Path) -> dict[str, Any] | None:
    """Return the figures by which the capture judges a model; None if it is too small for them."""
    from capture.mapping.covariance import standard_deviations
    from capture.mapping.model_metrics import model_metrics
    from capture.mapping.triplets import agreement, model_triplets

    model = pycolmap.Reconstruction(folder)
    try:
        agreed = agreement(model_triplets(model, str(database)))
        return dict(msgspec.to_builtins(model_metrics(folder, standard_deviations(model)[0], agreed)))
    except (ArithmeticError, IndexError, ValueError):
        return None


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
