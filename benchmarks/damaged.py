"""What the commands give for each input that broke release 1.0.0.

    python -m benchmarks.damaged [FOLDER | --videos]

FOLDER is the collection of damaged inputs (default `../shared/data/damaged`); `--videos` tries the videos of
`tests/synthetic/refused_videos.py`. Each runs in a process of its own, on a
copy, with an overlay where there are pictures (`estimate-scale`; pages go through `metric-tree extract`): exit status,
seconds of processor time, peak memory, whether control characters reached the output, and the answer in a line. The
table is in Markdown.
"""

from __future__ import annotations

import argparse
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.child import ChildRun, ours, run_child

__all__ = ["damaged_runs", "main", "video_runs"]

FOLDER = Path(__file__).resolve().parents[1].parent / "shared" / "data" / "damaged"
#: Signs that a terminal takes for commands.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]")
#: Where the pages are said to be from.
PAGE_URL = "https://www.shop.example/p/1"
#: Scene in which the damaged clouds and side files are tried.
SCENE = FOLDER.parent / "scenes" / "tum_office"
DEMO = Path(__file__).resolve().parents[1] / "data" / "scenes" / "demo_room"
#: The camera of the video that drifts turns too little to determine its focal length, which would be refused first.
VIDEO_OPTIONS = {"drift": ("--focal", 250)}
SECONDS = 120


def damaged_runs(folder: Path = FOLDER) -> Iterator[tuple[str, ChildRun]]:
    """The name and the run of every input of the collection."""
    for entry in sorted(folder.iterdir()):
        with tempfile.TemporaryDirectory() as temporary:
            words = _command(entry, Path(temporary))
            if words is not None:
                yield entry.name, run_child(ours(*words), SECONDS)


def video_runs(folder: Path) -> Iterator[tuple[str, ChildRun]]:
    """The name and the run of every video that must be refused."""
    from tests.synthetic.refused_videos import RARE_VIDEOS, REFUSED_VIDEOS
    from tests.synthetic.videos import times_of, write_video

    for name, frames in (REFUSED_VIDEOS | RARE_VIDEOS).items():
        file = folder / f"{name}.mp4"
        pictures = [frame.colour for frame in frames()]
        write_video(file, pictures, times_of(len(pictures), rate=10.0))
        words = (file, "--work", folder / f"{name}.work", *VIDEO_OPTIONS.get(name, ()))
        yield name, run_child(ours("estimate-scale", *words), SECONDS)


def _command(entry: Path, work: Path) -> list[str] | None:
    """The command that tries the input; None if no command reads it."""
    if entry.suffix == ".html":
        return ["metric-tree", "extract", str(entry), "--url", PAGE_URL]
    words = _estimate_words(entry, work)
    return None if words is None else ["estimate-scale", *words]


def _estimate_words(entry: Path, work: Path) -> list[str] | None:
    """The arguments of `estimate-scale` that try the input."""
    if entry.is_dir():
        scene = _copy(entry, work / "scene")
        return [str(scene), "--overlay", str(work / "overlay")] if (scene / "images").is_dir() else [str(scene)]
    if entry.suffix == ".ply":
        return [str(SCENE), "--dense", str(entry)]
    if entry.name.endswith("categories.json"):
        scene = _copy(DEMO, work / "scene")
        (scene / "instances.json").unlink(missing_ok=True)
        (scene / "instances").mkdir()
        shutil.copyfile(entry, scene / "instances" / "categories.json")
        return [str(scene)]
    if entry.name.startswith("truth_error"):
        scene = _copy(DEMO, work / "scene")
        shutil.copyfile(entry, scene / "truth.json")
        return [str(scene), "--figure", str(work / "figure.png")]
    return ["--objects", str(entry)] if entry.suffix == ".json" else None


def _copy(source: Path, target: Path) -> Path:
    shutil.copytree(source, target, copy_function=shutil.copyfile)
    for path in [target, *target.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)
    return target


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--videos", action="store_true", help="videos that must be refused, in place of the folder")
    arguments = parser.parse_args()
    print("| input | exit | seconds | MiB | control characters | answer |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for name, run in video_runs(Path(scratch)) if arguments.videos else damaged_runs(arguments.folder):
            status = "killed" if run.timed_out else run.status
            control = "yes" if _CONTROL.search(run.output + run.errors) else "none"
            cells = (f"`{name}`", status, f"{run.cpu_s:.1f}", f"{run.peak_mib:.0f}", control, _answer(name, run))
            print(f"| {' | '.join(map(str, cells))} |", flush=True)


def _answer(name: str, run: ChildRun) -> str:
    """The line that says most: the error, or the scale, or the first fact of a page."""
    lines = [line.strip() for line in run.output.splitlines() if line.strip()]
    answer = next((line for line in lines if re.match(r"(scale|unresolved|extents_mm|dimensions_text)", line)), "")
    if name.endswith(".html") and run.status == 0 and not answer:
        answer = "an item without a size"
    answer = answer or next(iter(run.errors.strip().splitlines()), "") or next(iter(lines), "")
    return re.sub(r"/\S*/", "", answer)[:160].replace("|", "\\|")


if __name__ == "__main__":
    main()
