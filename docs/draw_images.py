"""Write the images of the documentation from the shipped scenes: `make pictures`.

Each image is written with one or two commands. `docs/images/results.json` contains for each image its size, its
commands and the numbers of the results, so that a test can compare them with those of the program. `walk.jpg` needs
two minutes, because its video is reconstructed first; the others need 20 seconds.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from metric_cli.estimate_scale.estimate import main as estimate_scale  # noqa: E402
from metric_cli.insert_object.insert import main as insert_object  # noqa: E402

PICTURES = ROOT / "docs" / "images"
SCENES = ROOT / "data" / "scenes"
HORSE = ROOT / "data" / "models" / "rocking_horse.glb"
#: JPEG quality of the images.
QUALITY = 85
#: Width in pixels of an image of one panel.
WIDTH_PX = 1280
#: First and last frame of the video in `walk.jpg`, which shows the frame between them, too.
WALK_FRAMES = (110, 170)

#: The numbers of an image: `metres_per_unit`, the sizes of objects in metres.
Numbers = dict[str, Any]


def street(work: Path) -> tuple[Image.Image, Numbers]:
    """Draw the boxes of `lund_street` next to an inserted rocking horse 0.9 m high."""
    numbers = _estimate(SCENES / "lund_street", work, "--overlay", str(work / "frames"))
    insertion = ["--model", str(HORSE), "--size", "height=0.9", "--facing", "60", "--at", "frame=20.jpg,x=420,y=620"]
    scale = ["--scale", str(work / "result.json")]
    _run(insert_object, str(SCENES / "lund_street"), *scale, *insertion, "--frames", "3:3", "--out", str(work / "out"))
    return _panels([work / "frames" / "20.jpg", work / "out" / "20.png"], WIDTH_PX), numbers


@cache
def demo_room() -> dict[str, tuple[Image.Image, Numbers]]:
    """Draw the three images of `demo_room` in one run.

    They are: boxes and sizes of its objects; likelihood of each object and posterior of the scale; points, cameras,
    planes and boxes.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        files = {"posterior.png": work / "figure.png", "view.png": work / "view.png"}
        outputs = ["--figure", str(files["posterior.png"]), "--view-png", str(files["view.png"])]
        numbers = _estimate(SCENES / "demo_room", work, "--overlay", str(work / "frames"), *outputs)
        frames = sorted((work / "frames").iterdir())
        files["overlay.jpg"] = frames[len(frames) // 2]
        return {name: (_panels([file], WIDTH_PX), numbers) for name, file in files.items()}


def walk(work: Path) -> tuple[Image.Image, Numbers]:
    """Draw three frames of the video that `make demo-video` writes."""
    video = str(SCENES / "walk_carpark" / "video.mp4")
    _run(estimate_scale, video, "--work", str(work / "walk"), "--frames", "30")
    insertion = ["--model", str(HORSE), "--size", "height=0.9", "--facing", "60", "--at", "frame=150,x=390,y=350"]
    ends = "{}:{}".format(*WALK_FRAMES)
    _run(insert_object, str(work / "walk"), *insertion, "--frames", ends, "--out", str(work / "out"))
    frames = sorted((work / "out").glob("*.png"))
    result = json.loads((work / "walk" / "result.json").read_text(encoding="utf-8"))
    return _panels([frames[0], frames[len(frames) // 2], frames[-1]], 2 * WIDTH_PX), _numbers(result)


#: Names of the images, and the functions that draw them.
IMAGES: dict[str, Callable[[Path], tuple[Image.Image, Numbers]]] = {
    "street.jpg": street,
    "overlay.jpg": lambda _: demo_room()["overlay.jpg"],
    "posterior.png": lambda _: demo_room()["posterior.png"],
    "view.png": lambda _: demo_room()["view.png"],
    "walk.jpg": walk,
}


def draw(name: str, folder: Path) -> Numbers:
    """Write an image to `folder` and return its size and numbers."""
    with tempfile.TemporaryDirectory() as work:
        image, numbers = IMAGES[name](Path(work))
    image.save(folder / name, quality=QUALITY, optimize=True)
    return {"size": list(image.size), **numbers}


def _run(command: Callable[[list[str]], int], *words: str) -> None:
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as messages:
        status = command(list(words))
    if status != 0:
        raise RuntimeError(f"{' '.join(words)}: exit status {status}\n{messages.getvalue()}")


def _estimate(scene: Path, work: Path, *options: str) -> Numbers:
    result = work / "result.json"
    _run(estimate_scale, str(scene), "--output", str(result), *options)
    return _numbers(json.loads(result.read_text(encoding="utf-8")))


def _numbers(result: dict[str, Any]) -> Numbers:
    """Return the scale, its interval, and the name, metres and verdict of each object, rounded to three digits."""
    objects = {
        f"{row['category']} {index}": [
            *(float(f"{metres:.3g}") for metres in row["dimensions_m"].values()),
            row["verdict"],
        ]
        for index, row in enumerate(result["objects"], 1)
    }
    scales = [
        float(f"{value:.3g}") for value in (result["scale"], result["interval"]["low"], result["interval"]["high"])
    ]
    return {"metres_per_unit": scales[0], "interval": scales[1:], "objects": objects}


def _panels(files: list[Path], width_px: int) -> Image.Image:
    """Return images of equal height next to each other, scaled to a common width."""
    panels = [Image.open(file).convert("RGB") for file in files]
    height = min(panel.height for panel in panels)
    panels = [panel.resize((round(panel.width * height / panel.height), height)) for panel in panels]
    sheet = Image.new("RGB", (sum(panel.width for panel in panels), height))
    left = 0
    for panel in panels:
        sheet.paste(panel, (left, 0))
        left += panel.width
    return sheet.resize((width_px, round(height * width_px / sheet.width)), Image.Resampling.LANCZOS)


def main(names: list[str]) -> None:
    """Write the named images, or all of them, and their numbers."""
    file = PICTURES / "results.json"
    results = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for name in names or IMAGES:
        results[name] = draw(name, PICTURES)
    file.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
