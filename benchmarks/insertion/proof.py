"""The page docs/evidence/insertion.md: `python -m benchmarks.insertion.proof --work DIR [--traced DIR ...]`.

DIR holds `videos.jsonl` of `benchmarks.insertion.video_proof` and `occlusion.jsonl` of
`benchmarks.insertion.occlusion_proof`; the last row of each video, room and setting counts. Traced folders are those of
`benchmarks.insertion.traced_room`, whose figures of light are taken over.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from insertion.records.encoding import srgb_to_linear

__all__ = ["main"]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--traced", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=Path("docs/evidence"))
    options = parser.parse_args()
    if options.traced:
        _write_traced(options.out / "insertion" / "traced_rooms.jpg", options.traced)
    (options.out / "insertion.md").write_text(_page(options.work, options.traced), encoding="utf-8")
    print(options.out / "insertion.md")


def _page(work: Path, traced: Sequence[Path]) -> str:
    template = Path(__file__).with_name("proof_page.md").read_text(encoding="utf-8")
    videos = {row["condition"]: row for row in _rows(work / "videos.jsonl")}
    places = {(row["room"], row["setting"]): row for row in _rows(work / "occlusion.jsonl")}
    light = [_light_row(folder) for folder in traced] if traced else _kept_light_rows()
    parts = {
        "VIDEOS": [_video_row(row) for row in videos.values()],
        "OCCLUSION": _occlusion_rows(places),
        "LIGHT": light,
    }
    for name, lines in parts.items():
        template = template.replace(f"{{{name}}}", "\n".join(lines))
    return template


def _rows(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def _video_row(row: dict[str, Any]) -> str:
    poses, heights = row["poses"], row["height_ratio"]
    edge = "" if row.get("edge_px") is None else f"{row['edge_px']:.1f} ({row['edge_p90_px']:.1f})"
    cells = [
        row["condition"],
        f"{poses['posed']}",
        f"{poses['median_px']:.2f}, {poses['worst_px']:.2f}",
        *(f"{heights[error]:.3f}" for error in ("0.9", "1.0", "1.1")),
        f"{row['whole']}",
        f"{row['colour']:.0f}",
        f"{row['flicker']:.1f}, {row['flicker_faces']:.1f}",
        edge,
    ]
    return f"| {' | '.join(cells)} |"


def _occlusion_rows(places: dict[tuple[str, str], dict[str, Any]]) -> list[str]:
    settings = list(dict.fromkeys(setting for _, setting in places))
    lines = [f"| room | hidden | {' | '.join(settings)} |", f"|---|---|{'---|' * len(settings)}"]
    for room in dict.fromkeys(name for name, _ in places):
        rows = [places[room, setting] for setting in settings]
        cells = [f"{row['edge_px']:.1f} ({row['edge_p90_px']:.0f}), {100 * row['wrong']:.0f} %" for row in rows]
        lines.append(f"| {room} | {100 * rows[0]['hidden']:.0f} % | {' | '.join(cells)} |")
    means = [[places[room, setting] for room in dict.fromkeys(name for name, _ in places)] for setting in settings]
    cells = [
        f"{np.mean([row['edge_px'] for row in rows]):.1f}, {100 * np.mean([row['wrong'] for row in rows]):.0f} %"
        for rows in means
    ]
    return [*lines, f"| mean | | {' | '.join(cells)} |"]


def _write_traced(file: Path, folders: Sequence[Path]) -> None:
    """One view of each traced room, twice as large: without the object, with it inserted, with it really there."""
    import cv2

    rows = [cv2.imread(str(sorted(folder.glob("compare_*.png"))[-1])) for folder in folders]
    sheet = np.vstack([cv2.resize(row, None, fx=1.6, fy=1.6, interpolation=cv2.INTER_CUBIC) for row in rows])
    cv2.imwrite(str(file), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])


def _kept_light_rows() -> list[str]:
    """The rows of light that the page has now, for a run without traced rooms."""
    page = Path("docs/evidence/insertion.md").read_text(encoding="utf-8")
    return [line for line in page.split("## Light")[1].split("\n## ")[0].splitlines() if line.startswith("| ")][1:]


def _light_row(folder: Path) -> str:
    records = _rows(folder / "records.jsonl")
    cells = [folder.name.replace("_", " "), f"{np.mean([row['mean_abs_srgb'] for row in records]):.1f}"]
    light, *shadows = (
        " ".join(f"{row[name]:.2f}" for row in records) for name in ("luminance_ratio", "shadow_true", "shadow_ours")
    )
    cells += [light, f"{np.exp(np.mean([np.log(_red_over_blue(row)) for row in records])):.2f}", *shadows]
    return f"| {' | '.join(cells)} |"


def _red_over_blue(record: dict[str, Any]) -> float:
    """Linear red over blue of the object over that of the true one."""
    ours, true = (srgb_to_linear(np.rint(record[f"mean_srgb_{name}"]).astype(np.uint8)) for name in ("ours", "true"))
    return float(ours[0] / ours[2] * true[2] / true[0])


if __name__ == "__main__":
    main()
