"""How true the scale of a film is, from the file to the answer, and whether dense points change it.

`python -m benchmarks.insertion.film_accuracy kitchen:1010 --out DIR` films made rooms, runs `estimate-scale` on each,
and prints one row of docs/evidence/films.md for each; with `--dense` the scale from the dense points, too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from estimator.reading import read_scene
from tests.made.rooms.similarity import similarity_between
from tests.made.videos import Lens, made_video, room

__all__ = ["main"]

COMMAND = "import sys; from estimator.command import main; sys.exit(main(sys.argv[1:]))"
FRAMES = 60


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("films", nargs="+", help="KIND:SEED")
    parser.add_argument("--frames", type=int, default=24, help="to reconstruct from")
    parser.add_argument("--dense", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    for film in options.films:
        kind, seed = film.rsplit(":", 1)
        folder = options.out / f"{kind.replace(' ', '-')}-{seed}"
        if not (folder / "truth.json").is_file():
            made_video(room(kind, int(seed), frames=FRAMES), Lens(), folder)
        print(_row(f"{kind} {seed}", folder, options.frames, options.dense), flush=True)


def _row(name: str, folder: Path, frames: int, dense: bool) -> str:
    """`| room | focal length | scale over truth | interval | seconds |`, and the same from dense points."""
    work = folder / "work"
    words = [folder / "video.mp4", "--work", work, "--instances", folder / "instances.json", "--frames", frames]
    started, cpu = time.perf_counter(), _child_seconds()
    result = _estimate([*words, *(["--dense", "auto"] if dense else [])])
    seconds = f"{time.perf_counter() - started:.0f} | {_child_seconds() - cpu:.0f}"
    report = json.loads((work / "reconstruction.json").read_text())["model"]
    cells = [name, f"{report['registered']} of {frames}", f"{report['focal'] * 640 / 500 - 1:+.2%}"]
    true = _true_scale(folder, work)
    cells += [_against(result, true), seconds]
    if dense:
        cells.append(_against(_estimate([work, "--dense", work / "dense.ply"]), true))
    return f"| {' | '.join(cells)} |"


def _estimate(words: list[Any]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *map(str, words), "--json"], stdout=subprocess.PIPE, check=True
    )
    record: dict[str, Any] = json.loads(done.stdout)
    return record


def _child_seconds() -> float:
    return sum(os.times()[2:4])


def _true_scale(folder: Path, work: Path) -> float:
    """Metres per unit of the reconstruction, by its camera centres."""
    truth = json.loads((folder / "truth.json").read_text())["frames"]
    views = read_scene(work).views
    rows = [truth[int(Path(view.name).stem)] for view in views]
    true = np.array([-np.array(row["rotation"]).T @ row["translation"] for row in rows])
    return 1 / float(similarity_between(true, np.array([view.centre for view in views])).scale)


def _against(result: dict[str, Any], true: float) -> str:
    interval = result["interval"]
    return (
        f"{result['scale'] / true - 1:+.1%} | {interval['low'] / true - 1:+.0%} to {interval['high'] / true - 1:+.0%}"
    )


if __name__ == "__main__":
    main()
