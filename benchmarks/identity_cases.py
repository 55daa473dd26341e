"""The cases of `benchmarks.identity`: command lines and uses of the public API, by part.

Paths are relative to the checkout that runs; `{out}` is the output folder of a case. A case whose input is missing is
omitted, in the same way on both sides of a comparison.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

__all__ = ["CAPTURES", "PARTS", "Case"]

#: Real scenes, captures, models, pages and tables next to the checkout.
SHARED = "../shared/data"
MODEL = "data/models/rocking_horse.glb"
LAMPS = "data/examples"
LAMPS_URL = "https://lamps.example/1"
DEMO = "data/scenes/demo_room"
TUM = f"{SHARED}/scenes/tum_office"
#: Captures by the name of their work folder: input and options of `estimate-scale`. `seoul_bull` tries four camera
#: models, `banana_lowtex` and `box_desk` have little texture (no masks, so exit status 2); the others have a scale.
CAPTURES = {
    "demo_video": "data/scenes/demo_video/video.mp4 --instances data/scenes/demo_video/instances.json --frames 20",
    "walk_carpark": "data/scenes/walk_carpark/video.mp4 --frames 20",
    "seoul_bull": f"{SHARED}/captures/seoul_bull/images",
    "banana_lowtex": f"{SHARED}/captures/banana_lowtex/images",
    "box_desk": f"{SHARED}/captures/box_desk/images",
}
#: Raw items of a build that takes 30 s: sizes from a standard, a register and two sets of 3-D models, with images.
RAW = " ".join(
    f"data/raw/{name}.jsonl.gz" for name in ("paper_sizes", "energy_star_2025", "gazebo_models", "tdw_models")
)


@dataclass(frozen=True)
class Case:
    """A process to run.

    name : `part/case`, and the output folder. words : command line. code : Python code that runs instead of the
    program. split : one entry per key of the JSON output. fresh : a capture from the start, which is compared with a
    tolerance. work : name of a work folder that is copied to `{out}/work`, with all stages or with `features_only`.
    """

    name: str
    program: str
    words: tuple[str, ...]
    code: str = ""
    split: bool = False
    fresh: bool = False
    work: str = ""
    features_only: bool = False


def _case(name: str, line: str, *, split: bool = False, work: str = "", features_only: bool = False) -> Case:
    """A case from a line as in a shell: `metric-tree list --json`."""
    program, *words = shlex.split(line)
    program = program.replace("-", "_")
    return Case(name, program, tuple(words), split=split, work=work, features_only=features_only)


def scenes(root: Path) -> list[Case]:
    """Every scene with a reconstruction, every method, other inputs of a scene, and all outputs of another."""
    found = [
        model.parent for top in ("data/scenes", f"{SHARED}/scenes") for model in sorted((root / top).glob("*/sparse"))
    ]
    lines = {"_".join(scene.parts[-3:]): f"{scene.relative_to(root)} --json" for scene in found}
    lines |= {f"{method}_method": f"{DEMO} --json --method {method}" for method in ("paper", "sucar", "height")}
    lines |= {
        "all_outputs": f"{DEMO} --json --output {{out}}/result.json --figure {{out}}/figure.png"
        " --view-png {out}/view.png --view-glb {out}/view.glb --write-scaled {out}/scaled --overlay {out}/overlay",
        "classes": f"{DEMO} --json --leave-one-class-out --level 0.5 --camera-height 1.5+-0.15",
        "known_length": f"{DEMO} --json --known-length 0,0,0 0,0,1 3.3 --trust-known-length",
        "plan_of_objects": f"{DEMO} --csv --wide --where region=europe,year=2011 --up 0,0,1",
    }
    if (root / TUM).is_dir():
        lines |= {
            "tum_dense": f"{TUM} --json --dense {TUM}/dense.ply",
            "tum_sparse": f"{TUM} --json --dense none",
            "tum_text": f"{TUM}/sparse_txt --json --instances {TUM}/instances.json",
            "tum_opensfm": f"{TUM}/opensfm --json --instances {TUM}/instances.json",
            "tum_scaled": f"{TUM}/opensfm --json --instances {TUM}/instances.json --write-scaled {{out}}/scaled",
            "tum_boxes": f"{TUM} --json --instances {TUM}/detections_yolo.json"
            f" --categories {TUM}/detections_yolo_categories.json",
        }
    damaged = root / SHARED / "damaged"
    for scene in sorted(path for path in damaged.glob("*") if path.is_dir()):
        lines[f"damaged_{scene.name}"] = f"{SHARED}/damaged/{scene.name} --json"
    for objects in sorted(damaged.glob("*objects_x*.json")):
        lines[f"{objects.stem}"] = f"--objects {SHARED}/damaged/{objects.name} --json"
    resumed = _case(
        "scenes/video_resumed", f"estimate-scale {CAPTURES['demo_video']} --json --work {{out}}/work", work="demo_video"
    )
    return [*(_case(f"scenes/{name}", f"estimate-scale {line}") for name, line in lines.items()), resumed]


#: `metric-tree query NAME --json` for 200 names of the release, in one process.
QUERIES = """
import contextlib, io, json, sys
import metric_tree
from metric_cli import programs
names = sorted(name for name, _ in metric_tree.open().names())
answers = {}
for name in names[7 :: len(names) // 200]:
    sys.argv = ["metric-tree", "query", name, "--json"]
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(sys.stdout):
        try:
            status = programs.metric_tree()
        except SystemExit as end:
            status = end.code
    answers[name] = [status, json.loads(out.getvalue()) if status == 0 else None]
print(json.dumps(answers))
"""
#: `Tree.resolve` for all names, for about 3,000 phrases, and for all labels of the label lists next to the checkout.
RESOLUTIONS = """
import csv, json, sys
from pathlib import Path
import metric_tree
tree = metric_tree.open()
names = sorted(name for name, _ in tree.names())
def answer(text, vocabulary=None, advice=False):
    try:
        meaning = tree.resolve(text, vocabulary, advice=advice)
    except ValueError as error:
        return [text, type(error).__name__]
    others = [node.node_id for node in meaning.alternatives]
    return [text, meaning.node.node_id, meaning.how, str(meaning.margin), others, meaning.ambiguous]
forms = ("blue wooden {}", "{}s", "two pairs of {}", "{}q", "the kitchen {}", "{} lamp")
phrases = [form.format(name) for name in names[:: len(names) // 480] for form in forms]
groups = {"names": [answer(name) for name in names], "phrases": [answer(phrase) for phrase in phrases]}
answers = {}
for key, rows in groups.items():
    answers |= {f"{key} {start}": rows[start : start + 250] for start in range(0, len(rows), 250)}
for file in sorted(Path(sys.argv[1]).glob("*.csv")):
    with file.open(encoding="utf-8", newline="") as rows:
        labels = [next(iter(row.values())) for row in csv.DictReader(rows)]
    answers[file.name] = [answer(label, file.stem) for label in labels] + [answer(label) for label in labels]
def interval(node):
    try:
        return node.prior(node.dims).interval(0.9).tolist()
    except ValueError as error:
        return type(error).__name__
answers["priors"] = [[node.node_id, node.n_items, interval(node)] for node in list(tree)[::4]]
answers["search"] = [[n, [node.node_id for node in tree.search(n)]] for n in phrases[::60]]
print(json.dumps(answers))
"""


def queries(_root: Path) -> list[Case]:
    """Queries, resolution of names, priors, search, and the other reading commands."""
    lines = {
        "diff": "diff 2.0.0 3.0.0 --json",
        "priors": "priors --csv",
        "priors_coco": "priors --vocabulary coco_80 --json",
        "where": "query car --where europe,2011 --json",
        "dims": "query chair --dims height,width --json",
        "select": "select --json",
        "validate": "validate data/release/2.0.0 --json",
    }
    return [
        Case("queries/query", "", (), QUERIES, split=True),
        Case("queries/resolve", "", (f"{SHARED}/vocab",), RESOLUTIONS, split=True),
        *(_case(f"queries/{name}", f"metric-tree {line}", split=name == "diff") for name, line in lines.items()),
    ]


def build(_root: Path) -> list[Case]:
    """A release of four raw files; nothing without WordNet."""
    folder = Path(os.environ.get("METRIC_TREE_WORDNET", "/usr/share/wordnet"))
    if not (folder / "data.noun").is_file():
        return []
    line = f"metric-tree build {RAW} --out {{out}}/release --log {{out}}/log --created 2026-01-01 --workers 1"
    return [_case("build/four_sources", line)]


def insertion(root: Path) -> list[Case]:
    """One and two objects, layers and exports, lossless video, animation and path; with each renderer that exists."""
    one = f"insert-object {DEMO} --model {MODEL} --scale 0.2757 --json"
    lines = {
        "one": f"{one} --frames 0:2 --out {{out}}/frames",
        "two": f"{one} --size height=0.5 --model {MODEL} --size height=0.3 --facing 40 --frames 0:2"
        " --out {out}/frames --layers {out}/layers --export {out}/export",
        "preview": f"{one} --preview {{out}}/preview.png",
        "on_table": f"{one} --size height=0.15 --on 'coffee table' --facing wall --frames 3:3 --out {{out}}/frames",
        "prior": f"{one} --size prior --category 'rocking horse' --plane 0 --frames 3:3 --out {{out}}/frames",
        "path": f"{one} --plane 0 --path '-0.3,0 0.3,0' --speed 0.5 --frames 0:1 --out {{out}}/frames",
    }
    street = f"{SHARED}/scenes/walk_carpark"
    if (root / street).is_dir():
        lines["outdoors"] = (
            f"insert-object {street} --model {MODEL} --size height=0.9 --scale 1 --json --frames 0:1"
            " --codec lossless --out {out}/video.mkv"
        )
    if os.environ.get("METRIC_TREE_BLENDER") or shutil.which("blender"):
        lines["cycles"] = f"{one} --renderer blender --frames 0:0 --out {{out}}/frames"
    interval = (
        f"estimate-scale {DEMO} --quiet --output {{out}}/result.json --then insert-object {DEMO} --model {MODEL}"
        " --scale {out}/result.json --frames 0:1 --out {out}/frames --show-interval"
    )
    cases = [_case(f"insertion/{name}", line) for name, line in lines.items()]
    cases.append(Case("insertion/interval", "", tuple(shlex.split(interval)), SEQUENCE))
    video = f"insert-object {{out}}/work --model {MODEL} --size height=0.4 --json --frames 20:23"
    outputs = {"video": "--out {out}/video.mkv --codec lossless --layers {out}/layers", "h264": "--out {out}/video.mp4"}
    return [*cases, *(_case(f"insertion/{key}", f"{video} {line}", work="demo_video") for key, line in outputs.items())]


def capture(root: Path) -> list[Case]:
    """Captures from stored features, which are exact, and one from the start."""
    lines = {name: f"estimate-scale {line} --json --work {{out}}/work" for name, line in CAPTURES.items()}
    cases = [_case(f"capture/{name}", line, work=name, features_only=True) for name, line in lines.items()]
    fresh = Case("capture/fresh", "estimate_scale", tuple(shlex.split(lines["demo_video"])[1:]), fresh=True)
    return [*(case for case in cases if (root / case.words[0]).exists()), fresh]


def dense(_root: Path) -> list[Case]:
    """A dense cloud without a graphics card."""
    line = f"estimate-scale {CAPTURES['demo_video']} --json --work {{out}}/work --dense auto"
    return [_case("dense/demo_video", line, work="demo_video")]


#: Responses of the explorer over HTTP: its OpenAPI description, queries, and errors.
SERVER = """
import json, re, subprocess, sys, urllib.error, urllib.request
start = "from metric_cli import programs; programs.metric_tree()"
server = subprocess.Popen([sys.executable, "-c", start, "serve", "--port", "0"], stderr=subprocess.PIPE, text=True)
try:
    address = next(found[0] for line in server.stderr if (found := re.search(r"http://[0-9.]+:[0-9]+", line)))
    answers = {}
    for path in sys.argv[1:]:
        try:
            with urllib.request.urlopen(address + path, timeout=60) as reply:
                kind, text = reply.headers["content-type"], reply.read().decode()
                answers[path] = [reply.status, kind, json.loads(text) if "json" in kind else text]
        except urllib.error.HTTPError as error:
            answers[path] = [error.code, error.headers["content-type"]]
finally:
    server.terminate()
    server.wait(20)
print(json.dumps(answers))
"""


def site(_root: Path) -> list[Case]:
    """The whole static site, responses of the server, and the folder of a data hub."""
    node = "/v1/nodes/chair.n.01"
    paths = ("/openapi.json", "/v1/releases", "/v1/search?q=chair", node, f"{node}/prior?dims=height", f"{node}/items")
    errors = ("/v1/nodes/nothing", "/v1/search", f"{node}/prior?dims=colour", "/nowhere")
    return [
        _case("site/static", "metric-tree site {out}/site --workers 1"),
        _case("site/publish", "metric-tree publish {out}/hub"),
        _case("site/report", "metric-tree report data/release/1.0.0 --out {out}/report.html"),
        Case("site/server", "", (*paths, *errors), SERVER, split=True),
    ]


def pages(root: Path) -> list[Case]:
    """Raw items of saved pages, and of all open data sets."""
    cases = [
        _case(
            "pages/example",
            f"metric-tree extract {LAMPS}/site/page.html --site {LAMPS}/site/lamps.toml --url {LAMPS_URL} --json",
        ),
        _case(
            "pages/example_source",
            f"metric-tree import lamps --sources {LAMPS}/source --input {LAMPS}/source --out {{out}}/items.jsonl",
        ),
    ]
    truth = root / SHARED / "pages/truth.json"
    if truth.is_file():
        for page in json.loads(truth.read_text())["pages"]:
            line = f"metric-tree extract {SHARED}/pages/{page['file']} --url '{page['url']}' --json"
            cases.append(_case(f"pages/{page['file'].removesuffix('.html.gz')}", line))
        cases.append(_case("pages/import_all", f"metric-tree import --all --input {SHARED}/sizes --out {{out}}/raw"))
    return cases


def models(root: Path) -> list[Case]:
    """Unit check and true size of 3-D models in every format, and rescaled copies."""
    cases = [
        _case("models/check", f"metric-tree check-asset {MODEL} --json"),
        _case("models/true_size", f"metric-tree true-size {MODEL} --category rocker --out {{out}}/m.glb --json"),
        _case("models/bake", f"metric-tree true-size {MODEL} --category chair --out {{out}}/m.glb --bake --json"),
    ]
    for folder in sorted(path for path in (root / SHARED / "models").glob("*") if path.is_dir()):
        line = f"metric-tree check-asset {folder.relative_to(root)} --out {{out}}/check.jsonl --fix {{out}}/fixed"
        cases.append(_case(f"models/{folder.name}", line))
    return cases


#: Command lines with exit status, output and files; `{s}` is the demo room. Most are errors.
COMMANDS = """
metric-tree list --json
metric-tree list --tree --depth 2
metric-tree query chair
metric-tree query qwertzuiop
metric-tree query bat --at-least norm
metric-tree query chair --dims height,colour
metric-tree query chair --where atlantis
metric-tree query table --vocabulary nothing
metric-tree search 'ofice chiar' --json
metric-tree explain nothing:1
metric-tree explain paper_sizes:a4 data/raw/paper_sizes.jsonl.gz --json
metric-tree validate nowhere
metric-tree validate --codes
metric-tree report nowhere
metric-tree diff 1.0.0 nowhere
metric-tree diff 1.0.0 2.0.0 --factor 1.5
metric-tree build nowhere --out {out}/r
metric-tree build data/raw/paper_sizes.jsonl.gz --out {out}/r --version one
metric-tree import --list --json
metric-tree import nothing
metric-tree extract nowhere.html --url https://www.ikea.com/
metric-tree review list --json
metric-tree check-asset nowhere.glb
metric-tree true-size {model}
metric-tree unknown
estimate-scale
estimate-scale nowhere
estimate-scale {s} --level 2
estimate-scale {s} --work w
estimate-scale {s} --gps x.csv
estimate-scale {s} --up 1,2
estimate-scale {s} --where region=mars
estimate-scale {s} --known-length 1 2
estimate-scale {s} --baseline a:b
estimate-scale {s} --marker x
estimate-scale {s} --metric-depth nowhere
estimate-scale {s} --method paper --where region=europe
estimate-scale {s} --view-png a.jpg
estimate-scale {s} --output no/such/x.json
estimate-scale {s} --instances {s}/truth.json
estimate-scale {s} --camera-height handheld --strict --quiet
estimate-scale --objects nowhere --csv
insert-object {s} --out {out}/f
insert-object {s} --model nowhere.glb --out {out}/f
insert-object {s} --model {model} --scale 0 --out {out}/f
insert-object {s} --model {model} --scale 1 --size 3 --out {out}/f
insert-object {s} --model {model} --scale 1 --plane 99 --out {out}/f
insert-object {s} --model {model} --scale 1 --frames 9:3 --out {out}/f
insert-object {s} --model {model} --scale 1 --at frame=0,x=-5,y=3 --out {out}/f
insert-object nowhere --model {model} --out {out}/f
"""


def commands(_root: Path) -> list[Case]:
    """Status, output and files of short command lines."""
    lines = [line.replace("{s}", DEMO).replace("{model}", MODEL) for line in COMMANDS.strip().splitlines()]
    return [_case(f"commands/{_name(line)}", line) for line in lines]


def _name(line: str) -> str:
    """A command line as the name of a folder."""
    kept = "".join(letter if letter.isalnum() or letter in "-=." else "_" for letter in line)
    return kept.replace("__", "_").strip("_")[:120]


#: Command lines one after another, separated by `--then`; the first failure ends them.
SEQUENCE = """
import itertools, subprocess, sys
for last, group in itertools.groupby(sys.argv[1:], lambda word: word == "--then"):
    if not last:
        program, *words = group
        code = f"import sys; from metric_cli import programs; sys.exit(programs.{program.replace('-', '_')}())"
        status = subprocess.run([sys.executable, "-c", code, *words]).returncode
        if status:
            sys.exit(status)
"""


#: Parts of `benchmarks.identity`, cheapest first.
PARTS: dict[str, Callable[[Path], list[Case]]] = {
    "commands": commands,
    "queries": queries,
    "scenes": scenes,
    "insertion": insertion,
    "build": build,
    "capture": capture,
    "models": models,
    "dense": dense,
    "pages": pages,
    "site": site,
}
