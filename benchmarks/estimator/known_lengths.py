"""What `estimate-scale` says of a known length that is right, and of lengths that are wrong by a factor.

    python -m benchmarks.estimator.known_lengths SCENE ...

SCENE is a folder with `truth.json`. The length is between two corners of the middle nine tenths of its points; its
metres are the true ones, times each factor. `contradicts` is whether a warning says so; `scale` is over the true one.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from estimator import read_scene
from metric_base.terminal import print_table

FACTORS = (1.0, 0.3, 0.5, 1.5, 2.0, 2.54, 3.28, 10.0)
COMMAND = "import sys; from estimator.command import main; sys.exit(main(sys.argv[1:]))"


def known_length(scene: Path) -> tuple[list[str], float]:
    """Two points of a scene as words, and the true metres between them."""
    points = read_scene(scene).points
    ends = np.quantile(points, [0.05, 0.95], axis=0)
    truth = json.loads((scene / "truth.json").read_text(encoding="utf-8"))["metres_per_unit"]
    return [",".join(map(str, end.tolist())) for end in ends], float(truth * np.linalg.norm(ends[1] - ends[0]))


def told(scene: Path, words: list[str], metres: float, factor: float) -> tuple[object, ...]:
    """A row of the table."""
    command = [sys.executable, "-c", COMMAND, str(scene), "--json", "--known-length", *words, str(factor * metres)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    result = json.loads(done.stdout)
    warnings = [line for line in result["warnings"] if "known length" in line]
    truth = json.loads((scene / "truth.json").read_text(encoding="utf-8"))["metres_per_unit"]
    scale = "" if result["scale"] is None else f"{result['scale'] / truth:.3f}"
    return (scene.name, f"x {factor:g}", result["status"], done.returncode, scale, "yes" if warnings else "no")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, metavar="SCENE")
    rows = []
    for scene in parser.parse_args().scenes:
        words, metres = known_length(scene)
        rows += [told(scene, words, metres, factor) for factor in FACTORS]
    print_table(("scene", "length", "status", "exit", "scale", "contradicts"), rows)


if __name__ == "__main__":
    main()
