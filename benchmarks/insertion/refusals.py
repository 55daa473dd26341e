"""What `estimate-scale` says of videos that cannot be used.

`python -m benchmarks.insertion.refusals --out DIR [NAME ...]` prints the exit status and the line on standard error for
each video of tests/synthetic/refused_videos.py.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from tests.synthetic.refused_videos import RARE_VIDEOS, REFUSED_VIDEOS
from tests.synthetic.videos import times_of, write_video

__all__ = ["main"]

VIDEOS = REFUSED_VIDEOS | RARE_VIDEOS
#: The camera of the video that drifts turns too little to determine its focal length, which would be refused first.
OPTIONS = {"drift": ["--focal", "250"]}
COMMAND = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main(sys.argv[1:]))"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("videos", nargs="*", metavar="NAME", help=", ".join(VIDEOS))
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.videos or VIDEOS:
        file = options.out / f"{name}.mp4"
        pictures = [frame.colour for frame in VIDEOS[name]()]
        write_video(file, pictures, times_of(len(pictures), rate=10.0))
        words = [sys.executable, "-c", COMMAND, str(file), "--work", str(options.out / f"{name}.work")]
        words += OPTIONS.get(name, [])
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        print(f"| `{name}` | {done.returncode} | {' / '.join(done.stderr.splitlines())} |", flush=True)


if __name__ == "__main__":
    main()
