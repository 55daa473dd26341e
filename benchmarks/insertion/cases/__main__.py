"""The paper's ten cases as far as our scenes go: writes docs/evidence/cases.md.

`python -m benchmarks.insertion.cases --out DIR [--case NAME ...] [--page docs/evidence]` records synthetic rooms and
streets, runs `estimate-scale` and `insert-object` on each and on real scenes beside the repository, and compares what
is drawn with the truth. Outcomes are kept in DIR, so that a second run goes on where the first stopped; the page is
written from all that are there. A case costs about a minute and a half of CPU.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.insertion.cases.case_list import CASES, Case
from benchmarks.insertion.cases.case_runs import Outcome, drawn_heights, run_case
from estimator.capture.video import Video

__all__ = ["main"]

OUTCOME = "outcome.json"
#: Stages of the table, and the stamps of the work folder that they sum.
STAGES = {
    "read": ("frames", "instances"), "features": ("features",), "matching": ("matches",),
    "mapping": ("mapping", "model"),
    "poses": ("poses",), "scale": ("scale",), "insertion": ("insertion",),
}  # fmt: skip
#: Pictures in a row of the sheet, and the width of each in pixels.
ACROSS, WIDTH = 4, 400


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--case", nargs="+", default=[], choices=[case.name for case in CASES], metavar="NAME")
    parser.add_argument("--page", type=Path, help="the folder of docs/evidence, to write cases.md and its sheet")
    options = parser.parse_args()
    for case in CASES:
        if not options.case or case.name in options.case:
            print(_row(case, _outcome(case, options.out / case.folder_name)), flush=True)
    if options.page is not None:
        _write_page(options.page, options.out)


def _outcome(case: Case, folder: Path) -> Outcome:
    """The kept outcome of a case, or a new one."""
    file = folder / OUTCOME
    if not file.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(asdict(run_case(case, folder))) + "\n", encoding="utf-8")
    return Outcome(**json.loads(file.read_text(encoding="utf-8")))


def _row(case: Case, outcome: Outcome) -> str:
    video, chosen = outcome.frames
    cells = [case.name, case.model_file.stem, f"{video}, {chosen}" if chosen else f"{video}"]
    if outcome.scale is None or outcome.interval is None:
        cells += [f"refused: {outcome.refusal}", "", ""]
    else:
        low, high = outcome.interval
        cells += [f"{outcome.scale:+.1%}", f"{low:+.0%} to {high:+.0%}{'' if outcome.inside else ', **outside**'}"]
        size = outcome.refusal if outcome.size is None else f"{outcome.size:+.1%} ({outcome.heights})"
        cells.append(size or "no frame shows all of it")
    seconds = [sum(outcome.seconds.get(stamp, 0.0) for stamp in stamps) for stamps in STAGES.values()]
    cells += [f"{value:.1f}" if value else "" for value in seconds] + [f"{sum(seconds):.0f}"]
    return f"| {' | '.join(cells)} |"


def _write_page(folder: Path, out: Path) -> None:
    done = [(case, out / case.folder_name) for case in CASES if (out / case.folder_name / OUTCOME).is_file()]
    rows = "\n".join(_row(case, _outcome(case, place)) for case, place in done)
    template = Path(__file__).with_name("page.md").read_text(encoding="utf-8")
    (folder / "cases.md").write_text(template.replace("{CASES}", rows), encoding="utf-8")
    shown = [place for case, place in done if not case.real and (place / "out.mp4").is_file()]
    _write_sheet(folder / "insertion" / "cases.jpg", [_best_frame(place) for place in shown])


def _best_frame(folder: Path) -> NDArray[np.uint8]:
    """The frame (h, w, 3) of the output in which most of the object is seen."""
    record = json.loads((folder / "insertion.json").read_text(encoding="utf-8"))
    heights = drawn_heights(record)
    best = max(heights, key=lambda number: heights[number] * record["frames"][number]["visible"], default=0)
    return next(frame.colour for frame in Video(folder / "out.mp4").frames() if frame.index == best)


def _write_sheet(file: Path, pictures: Sequence[NDArray[np.uint8]]) -> None:
    import cv2

    height = round(WIDTH * 3 / 4)
    cells = [cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA) for picture in pictures]
    cells += [np.zeros((height, WIDTH, 3), np.uint8)] * (-len(cells) % ACROSS)
    rows = [np.hstack(cells[k : k + ACROSS]) for k in range(0, len(cells), ACROSS)]
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main()
