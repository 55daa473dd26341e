"""Contact sheets of insertions: `python -m benchmarks.insertion.sheets --videos DIR [--traced DIR ...] --out DIR`.

Each cell is a part of a frame at its real size: inserted on the left, really there on the right. With `--blind KEY` the
two are in random order, and the order is written to the file KEY, for a person who guesses first.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.insertion.synthetic_videos import pictures_of

__all__ = ["main", "pairs_of_traced", "pairs_of_videos", "write_pairs"]

Picture = NDArray[np.uint8]
Pair = tuple[str, Picture, Picture]
#: Width and height of a cell, pairs a row of a sheet, and its largest size in bytes.
CELL, PAIRS_A_ROW, LARGEST = (300, 330), 2, 380_000
#: Traced rooms are small; they are shown so many times as large.
TRACED_TIMES = 2.0
#: A change of so many grey levels is the object's or its shadow's, not the codec's.
CHANGED = 25


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--videos", type=Path, help="the folder of `benchmarks.insertion.video_proof`")
    parser.add_argument("--traced", type=Path, nargs="*", default=[], help="of `benchmarks.insertion.traced_room`")
    parser.add_argument("--blind", type=Path, metavar="KEY", help="random order; the order is written here")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    groups = {
        "videos": pairs_of_videos(options.videos) if options.videos else [],
        "traced": pairs_of_traced(options.traced),
    }
    generator, key = np.random.default_rng(), {}
    for name, pairs in groups.items():
        if not pairs:
            continue
        swapped = generator.random(len(pairs)) < 0.5 if options.blind else np.zeros(len(pairs), bool)
        key[name] = ["right" if other else "left" for other in swapped]
        write_pairs(
            options.out / f"{name}.jpg",
            [(n, b, a) if o else (n, a, b) for (n, a, b), o in zip(pairs, swapped, strict=True)],
        )
    if options.blind:
        options.blind.write_text(json.dumps(key) + "\n")


def pairs_of_videos(folder: Path) -> list[Pair]:
    """Name, inserted and really there of every video: the frame that shows most of the object."""
    pairs = []
    for video in sorted(path.parent for path in folder.glob("*/true.mp4")):
        bare, ours, true = (pictures_of(video / f"{name}.mp4") for name in ("bare", "ours", "true"))
        changed = [np.abs(a.astype(int) - b).max(axis=-1) > CHANGED for a, b in zip(true, bare, strict=True)]
        frame = int(np.argmax([mask.sum() for mask in changed]))
        box = _box_about(changed[frame])
        pairs.append((video.name, ours[frame][box], true[frame][box]))
    return pairs


def pairs_of_traced(folders: Sequence[Path]) -> list[Pair]:
    """The same of traced rooms, two views each; their pictures are side by side: without, inserted, really there."""
    import cv2

    pairs = []
    for folder in folders:
        for file in sorted(folder.glob("compare_*.png"))[:3]:
            _, ours, true = np.split(np.asarray(cv2.imread(str(file)))[..., ::-1], 3, axis=1)
            large = [
                cv2.resize(p, None, fx=TRACED_TIMES, fy=TRACED_TIMES, interpolation=cv2.INTER_CUBIC)
                for p in (ours, true)
            ]
            pairs.append((f"{folder.name} {file.stem[-3:]}", large[0], large[1]))
    return pairs


def write_pairs(file: Path, pairs: Sequence[Pair]) -> None:
    """A JPEG of the pairs, each under its number and name, below LARGEST."""
    import cv2

    cells = [_labelled(number, name, np.hstack([a, b])) for number, (name, a, b) in enumerate(pairs)]
    height, width = (max(cell.shape[axis] for cell in cells) for axis in (0, 1))
    cells = [np.pad(c, ((0, height - c.shape[0]), (0, width - c.shape[1]), (0, 0))) for c in cells]
    cells += [np.zeros_like(cells[0])] * (-len(cells) % PAIRS_A_ROW)
    rows = [np.hstack(cells[k : k + PAIRS_A_ROW]) for k in range(0, len(cells), PAIRS_A_ROW)]
    for quality in (90, 82, 74, 64, 54, 44):
        data = cv2.imencode(".jpg", np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        if len(data) < LARGEST:
            break
    file.write_bytes(data.tobytes())


def _labelled(number: int, name: str, pair: Picture) -> Picture:
    import cv2

    strip = np.full((22, pair.shape[1], 3), 40, np.uint8)
    cv2.putText(strip, f"{number}: {name}", (6, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (230, 230, 230), 1, cv2.LINE_AA)
    return np.vstack([strip, pair])


def _box_about(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """A cell's rows and columns about the middle of a mask (h, w), inside the picture."""
    rows, columns = np.flatnonzero(mask.sum(axis=1) > 3), np.flatnonzero(mask.sum(axis=0) > 3)
    slices = []
    for side, cell, at in ((mask.shape[0], CELL[1], rows), (mask.shape[1], CELL[0], columns)):
        middle = int(at.mean()) if len(at) else side // 2
        start = int(np.clip(middle - cell // 2, 0, max(side - cell, 0)))
        slices.append(slice(start, start + min(cell, side)))
    return slices[0], slices[1]


if __name__ == "__main__":
    main()
