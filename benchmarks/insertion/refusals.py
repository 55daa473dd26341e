"""What `estimate-scale` says of films that cannot be used.

`python -m benchmarks.insertion.refusals --out DIR [NAME ...]` prints the exit status and the line on standard error for
each film of tests/made/refused_films.py.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from tests.made.refused_films import RARE_FILMS, REFUSED_FILMS
from tests.made.videos import times_of, write_video

__all__ = ["main"]

FILMS = REFUSED_FILMS | RARE_FILMS
#: The camera of the film that drifts turns too little to determine its focal length, which would be refused first.
OPTIONS = {"drift": ["--focal", "250"]}
COMMAND = "import sys; from estimator.command import main; sys.exit(main(sys.argv[1:]))"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("films", nargs="*", metavar="NAME", help=", ".join(FILMS))
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.films or FILMS:
        file = options.out / f"{name}.mp4"
        pictures = [frame.colour for frame in FILMS[name]()]
        write_video(file, pictures, times_of(len(pictures), rate=10.0))
        words = [sys.executable, "-c", COMMAND, str(file), "--work", str(options.out / f"{name}.work")]
        words += OPTIONS.get(name, [])
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        print(f"| `{name}` | {done.returncode} | {' / '.join(done.stderr.splitlines())} |", flush=True)


if __name__ == "__main__":
    main()
