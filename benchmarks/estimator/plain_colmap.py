"""Plain pycolmap on a folder of images: `python -m benchmarks.estimator.plain_colmap IMAGES OUT`.

Default options of every step: SIFT, exhaustive matching, the incremental mapper, one camera of the model
SIMPLE_RADIAL. The largest model is written to OUT/sparse, and a line of JSON to standard output.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from estimator.reconstructions.pycolmap_library import pycolmap


def main(images: Path, out: Path) -> None:
    """Reconstruct the images of a folder."""
    pycolmap.logging.minloglevel = 2
    (out / "models").mkdir(parents=True)
    (out / "sparse").mkdir()
    database = out / "database.db"
    reader = pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL")
    pycolmap.extract_features(database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    pycolmap.match_exhaustive(database)
    models = pycolmap.incremental_mapping(database, images, out / "models")
    model = max(models.values(), key=lambda one: one.num_reg_images(), default=None)
    result = {"placed": 0, "focal": None}
    if model is not None:
        model.write_binary(str(out / "sparse"))
        camera = min(model.cameras.items())[1]
        focal = float(camera.params[0]) / max(camera.width, camera.height)
        result = {"placed": model.num_reg_images(), "focal": round(focal, 4)}
    print(json.dumps(result))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
