"""Write a scene to a folder: `python -m tests.synthetic.rooms "sitting room" --seed 7 --out DIR [--quick]`."""

from __future__ import annotations

import argparse
from pathlib import Path

from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.reconstruct import FEATURES, QUALITY, reconstruct
from tests.synthetic.rooms.scene_files import write_scene
from tests.synthetic.rooms.street import street

parser = argparse.ArgumentParser(prog="python -m tests.synthetic.rooms", description=__doc__)
parser.add_argument("kind", choices=[*KINDS, "street"])
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--out", type=Path, required=True)
parser.add_argument("--quick", action="store_true", help="use the true depth with noise, without pycolmap")
parser.add_argument("--features", type=int, default=FEATURES, help="SIFT features per frame")
parser.add_argument("--quality", type=int, default=QUALITY, help="JPEG quality")
arguments = parser.parse_args()
world = street(arguments.seed) if arguments.kind == "street" else furnished_room(arguments.kind, arguments.seed)
if arguments.quick:
    synthetic = quick_scene(world, Knobs(), arguments.seed)
    write_scene(synthetic, world, arguments.out)
    truth = synthetic.truth
else:
    truth = reconstruct(world, arguments.out, arguments.seed, features=arguments.features, quality=arguments.quality)
print(f"{arguments.out}: {len(world.objects)} objects, {truth.metres_per_unit:.6g} metres per unit")
