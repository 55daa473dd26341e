"""Data flows one way: a room imports only rooms upstream of it, and light commands stay light."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatch
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.synthetic import minitree

ROOT = Path(__file__).resolve().parents[1]
#: The rooms, upstream first. A module of a room imports from its own room and from rooms above it in this list.
#: A package's own name is the room of the modules directly in it.
ROOMS = [
    "metric_base",
    "crawler",
    "crawler.text",
    "crawler.page",
    "crawler.sites",
    "crawler.fetch",
    "crawler.imports",
    "taxonomy",
    "taxonomy.words",
    "taxonomy.naming",
    "taxonomy.matching",
    "metric_tree",
    "metric_tree.fit",
    "metric_tree.pipeline",
    "metric_tree.checks",
    "metric_tree.cutouts",
    "metric_tree.training",
    "metric_tree.report",
    "models3d",
    "models3d.gltf",
    "estimator.records",
    "estimator.reconstructions",
    "estimator.scene_formats",
    "estimator.checks",
    "estimator.instances",
    "estimator.detectors",
    "estimator.projection",
    "estimator.association",
    "estimator.outlines",
    "estimator.geometry",
    "estimator.telemetry",
    "estimator.evidence",
    "estimator.posterior",
    "estimator.results",
    "estimator.baselines",
    "estimator.outputs",
    "estimator.views",
    "estimator.asset_files",
    "models3d.size_check",
    "capture.cameras",
    "capture.mapping",
    "capture.dense",
    "capture",
    "estimator",
    "insertion.colour",
    "insertion.models",
    "insertion.footage",
    "insertion.scene",
    "insertion.placement",
    "insertion.light",
    "insertion.render",
    "insertion.composite",
    "insertion.pipeline",
    "insertion.exports",
    "insertion.blender",
    "insertion.study",
    "insertion",
    "explorer.content",
    "explorer.charts",
    "explorer.pages",
    "explorer",
    "explorer.server",
    "metric_cli",
    "metric_cli.subcommands",
    "metric_cli.subcommands.data",
    "metric_cli.subcommands.models",
    "metric_cli.subcommands.release",
    "metric_cli.estimate_scale",
    "metric_cli.insert_object",
]
#: In the order of the flow.
PACKAGES = list(dict.fromkeys(room.partition(".")[0] for room in ROOMS))
#: More than this in one folder is hard to see.
MOST_MODULES = 16
#: What only the command line does: prints, parses options, exits.
TERMINAL = re.compile(r"\b(print\(|argparse\b|sys\.std(out|err|in)\b|sys\.exit\b|SystemExit\b|progress_bars?\b)")
#: Programs of their own, started by ours: their standard output is a pipe to the process that waits for them.
WORKERS = {
    "capture/mapping/colmap_worker.py",
    "capture/dense/patch_match_worker.py",
    "insertion/blender/layer_script.py",
    "insertion/blender/script.py",
}
#: What a query never loads.
HEAVY = [
    "sklearn",
    "open3d",
    "nltk",
    "scrapy",
    "pandas",
    "scipy",
    "matplotlib",
    "cv2",
    "pycolmap",
    "rembg",
    "dask",
    "jinja2",
    "starlette",
    "mcp",
    "urllib.request",
]


def _module(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _room(module: str) -> str:
    """The room that a module is in; a package (a folder) is its own room."""
    return module if (ROOT / module.replace(".", "/")).is_dir() else module.rpartition(".")[0]


def _imports(code: str) -> Iterator[str]:
    """The modules that code imports. `from room import name` is the module `room.name` if there is one."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "expected absolute imports"
            home = node.module or ""
            for alias in node.names:
                path = ROOT / home.replace(".", "/") / alias.name
                yield f"{home}.{alias.name}" if path.is_dir() or path.with_suffix(".py").is_file() else home


def _backward(room: str, code: str) -> set[str]:
    """The imports of a room's code that lead downstream. A package's `__init__` is a door to its rooms, not a room."""
    package = room.partition(".")[0]
    doors = set(PACKAGES[: PACKAGES.index(package) + 1])
    upstream = set(ROOMS[: ROOMS.index(room) + 1])
    ours = {name for name in _imports(code) if name.partition(".")[0] in PACKAGES}
    return {name for name in ours if name not in doors and (name in PACKAGES or _room(name) not in upstream)}


def _modules(package: str) -> Iterator[Path]:
    """The modules that the arrow binds: all but the package's own door."""
    for path in sorted((ROOT / package).rglob("*.py")):
        module = _module(path)
        if module != package:
            yield path


@pytest.mark.parametrize("package", PACKAGES)
def test_no_import_runs_back(package: str) -> None:
    back = {
        _module(path): sorted(names)
        for path in _modules(package)
        if (names := _backward(_room(_module(path)), path.read_text(encoding="utf-8")))
    }
    assert back == {}


def test_every_room_has_its_place_in_the_order() -> None:
    rooms = {_room(_module(path)) for package in PACKAGES for path in _modules(package)}
    assert rooms - set(ROOMS) == set()
    assert {room for room in ROOMS if not (ROOT / room.replace(".", "/")).is_dir()} == set()


def test_an_arrow_that_runs_back_is_seen() -> None:
    assert _backward("crawler.page", "import metric_tree.tree, json") == {"metric_tree.tree"}
    assert _backward("crawler.page", "from crawler.fetch import crawl") == {"crawler.fetch.crawl"}
    assert _backward("crawler", "import metric_tree") == {"metric_tree"}
    assert _backward("estimator.records", "from metric_tree import tree\nimport crawler.items") == set()


def test_modules_import_each_other_in_no_circle() -> None:
    """Commands too, and imports inside functions; the doors of the packages, which import lazily, are left out."""
    paths = {_module(path): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    modules = {name: path for name, path in paths.items() if path.name != "__init__.py"}
    graph = {name: set(_imports(path.read_text(encoding="utf-8"))) & set(modules) for name, path in modules.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def _code(path: Path) -> str:
    """A module without its docstrings and comments."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            node.value = ast.Constant(value=None)
    return ast.unparse(tree)


def test_nothing_below_the_command_line_prints_parses_or_exits() -> None:
    paths = (path for package in PACKAGES if package != "metric_cli" for path in (ROOT / package).rglob("*.py"))
    named = {str(path.relative_to(ROOT)): path for path in paths}
    prints = {name: TERMINAL.findall(_code(path)) for name, path in named.items() if name not in WORKERS}
    assert {name: uses for name, uses in prints.items() if uses} == {}
    assert set(named) >= WORKERS


@pytest.mark.parametrize("package", PACKAGES)
def test_a_folder_holds_few_modules_and_no_name_twice(package: str) -> None:
    paths = [path for path in (ROOT / package).rglob("*.py") if path.name != "__init__.py"]
    assert {str(folder): n for folder, n in Counter(path.parent for path in paths).items() if n > MOST_MODULES} == {}
    assert [name for name, n in Counter(path.name for path in paths).items() if n > 1] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_says_what_it_is_for(package: str) -> None:
    silent = [
        path for path in (ROOT / package).rglob("__init__.py") if not ast.get_docstring(ast.parse(path.read_text()))
    ]
    assert silent == []
    assert (ROOT / package / "py.typed").is_file()


def test_a_query_loads_nothing_heavy(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "mini").directory
    code = (
        f"import sys; import metric_tree; tree = metric_tree.open({str(directory)!r});"
        "node = tree.find('swivel chair'); node.prior().interval(0.9); node.items();"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
    command = (
        f"import sys; from metric_cli.subcommands import main; main(['query', 'swivel chair', '--tree', {str(directory)!r}]);"
        "print(sorted({'rich', 'email', 'pyarrow.compute', 'tempfile', 'gzip'} & set(sys.modules)))"
    )
    out = subprocess.run([sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.splitlines()[-1] == "[]"


def test_no_folder_of_tests_is_passed_over(pytestconfig: pytest.Config) -> None:
    """pytest's own list of folders that it does not enter has `build`, as a room is called."""
    folders = {path.parent for path in (ROOT / "tests").rglob("test_*.py")}
    names = {part for folder in folders for part in folder.relative_to(ROOT).parts}
    passed_over = [name for name in names for glob in pytestconfig.getini("norecursedirs") if fnmatch(name, glob)]
    assert passed_over == []
