"""Imports follow the layers of the architecture, and light commands load no heavy library."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.synthetic import minitree

ROOT = Path(__file__).resolve().parents[2]
#: The layers of the architecture, lowest first. A line lists modules or packages that are one layer: a module imports
#: from its own line and from the lines above it. The longest name that contains a module decides.
LAYERS = """
metric_base
crawler.items
crawler.text
crawler.page
crawler.sites
crawler.fetch
crawler.imports
taxonomy taxonomy.words
taxonomy.naming
taxonomy.matching
metric_tree
metric_tree.release
metric_tree.tree metric_tree.node
metric_tree.release.publication
metric_tree.reports
metric_tree.curated
metric_tree.fit
metric_tree.checks
metric_tree.pipeline
metric_tree.cutouts metric_tree.training
models3d.asset
models3d.gltf.document models3d.gltf.animation models3d.gltf.boxes
models3d models3d.usd models3d.gltf
models3d.formats models3d.rescaling
models3d.size_check
estimator.reconstructions.pycolmap_library
estimator.records
estimator.projection
estimator.reconstructions
estimator.scene_formats
estimator.reconstructions.scene_reader
estimator.instances
estimator.detectors
estimator.association
estimator.geometry
estimator.telemetry
estimator.evidence
estimator.posterior
estimator.results
estimator.baselines
estimator.outputs
estimator.views
estimator
capture
capture.sources
capture.mapping
capture.dense capture.masks
capture.caution_files
capture.quality_warnings
capture.localisation
capture.pipeline
insertion.colour insertion.footage insertion.scene
insertion.request insertion.result
insertion.light
insertion.render
insertion.placement
insertion.composite
insertion.exports insertion.blender
insertion.insertion_scene
insertion
insertion.placement_page insertion.insert
explorer explorer.charts
explorer.responses
explorer.tables explorer.fit explorer.queries
explorer.search_index
explorer.pages
explorer.routes
explorer.server explorer.static_site
metric_cli
"""
_LAYER_OF = {name: number for number, line in enumerate(LAYERS.split("\n")) for name in line.split()}
PACKAGES = tuple(dict.fromkeys(name.partition(".")[0] for name in _LAYER_OF))
#: Packages that do not import each other, although one is above the other in the list.
APART = {("explorer", "insertion"), ("insertion", "explorer")}
#: Constructs of the command line: printing, parsing of options, exits.
TERMINAL = re.compile(r"\b(print\(|argparse\b|sys\.std(out|err|in)\b|sys\.exit\b|SystemExit\b|progress_bars?\b)")
#: Programs that ours start: their standard output is a pipe to the process that waits for them.
WORKERS = {
    "capture/mapping/colmap_worker.py",
    "capture/dense/patch_match_worker.py",
    "insertion/blender/layer_script.py",
    "insertion/blender/script.py",
}
#: Modules that a query of the tree must not load.
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


def module_name(path: Path) -> str:
    """Return the dotted name of a module; the name of the package for its `__init__`."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def modules() -> Iterator[Path]:
    """Return all source modules except for `__init__` files, which re-export names lazily."""
    for package in PACKAGES:
        yield from (path for path in sorted((ROOT / package).rglob("*.py")) if path.name != "__init__.py")


def imported_modules(code: str) -> Iterator[str]:
    """Return the modules that code imports, also within functions."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "expected absolute imports"
            home = node.module or ""
            for alias in node.names:
                path = ROOT / home.replace(".", "/") / alias.name
                yield f"{home}.{alias.name}" if path.is_dir() or path.with_suffix(".py").is_file() else home


def layer(module: str) -> int:
    """Return the number of the layer of a module."""
    while module not in _LAYER_OF:
        module = module.rpartition(".")[0]
    return _LAYER_OF[module]


def imports_upwards(module: str, code: str) -> set[str]:
    """Return the imports of a module from a higher layer, or from a package that it must not import.

    A package itself (`import metric_tree`) denotes its public names and belongs to its highest layer.
    """
    ours = {name for name in imported_modules(code) if name.partition(".")[0] in PACKAGES}
    package = module.partition(".")[0]
    wrong = set()
    for name in ours:
        other = name.partition(".")[0]
        if name in PACKAGES and name != "metric_base":
            is_allowed = PACKAGES.index(other) < PACKAGES.index(package)
        else:
            is_allowed = layer(name) <= layer(module)
        if not is_allowed or (package, other) in APART:
            wrong.add(name)
    return wrong


def test_modules_import_from_their_layer_and_from_lower_ones() -> None:
    wrong = {
        module_name(path): sorted(names)
        for path in modules()
        if (names := imports_upwards(module_name(path), path.read_text(encoding="utf-8")))
    }
    assert wrong == {}


def test_layers_name_existing_modules() -> None:
    paths = {name: ROOT / name.replace(".", "/") for name in _LAYER_OF}
    assert [name for name, path in paths.items() if not path.is_dir() and not path.with_suffix(".py").is_file()] == []


def test_an_import_from_a_higher_layer_is_reported() -> None:
    assert imports_upwards("crawler.page.page", "import metric_tree.tree, json") == {"metric_tree.tree"}
    assert imports_upwards("crawler.page.page", "from crawler.fetch import crawl") == {"crawler.fetch.crawl"}
    assert imports_upwards("crawler.items", "import metric_tree") == {"metric_tree"}
    assert imports_upwards("explorer.routes", "from insertion.insert import Insertion") == {"insertion.insert"}
    assert imports_upwards("estimator.records.scene", "from metric_tree import tree\nimport crawler.items") == set()


def test_imports_have_no_cycle() -> None:
    """Imports within functions count; the lazy re-exports of `__init__` files do not."""
    names = {module_name(path): path for path in modules()}
    graph = {
        name: set(imported_modules(path.read_text(encoding="utf-8"))) & set(names) - {name}
        for name, path in names.items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError with the cycle


def test_only_commands_print_parse_options_or_exit() -> None:
    found = {}
    for path in modules():
        name = str(path.relative_to(ROOT))
        text = path.read_text(encoding="utf-8")
        if not name.startswith("metric_cli/") and name not in WORKERS and TERMINAL.search(text):
            tree = ast.parse(text)
            for node in ast.walk(tree):
                if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                    node.value = ast.Constant(value=None)  # docstrings may mention these names
            if uses := TERMINAL.findall(ast.unparse(tree)):
                found[name] = uses
    assert found == {}
    assert all((ROOT / name).is_file() for name in WORKERS)


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_have_a_docstring_and_types(package: str) -> None:
    paths = (ROOT / package).rglob("__init__.py")
    assert [path for path in paths if not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))] == []
    assert (ROOT / package / "py.typed").is_file()


def test_a_query_loads_no_heavy_library(tmp_path: Path) -> None:
    directory = minitree.release(tmp_path / "mini").directory
    code = (
        f"import sys; import metric_tree; tree = metric_tree.open({str(directory)!r});"
        "node = tree.find('swivel chair'); node.prior().interval(0.9); node.items();"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, timeout=300
    )
    assert out.stdout.strip() == "[]"
    command = (
        "import sys; from metric_cli.subcommands import main;"
        f"main(['query', 'swivel chair', '--tree', {str(directory)!r}]);"
        "print(sorted({'rich', 'email', 'pyarrow.compute', 'tempfile', 'gzip'} & set(sys.modules)))"
    )
    out = subprocess.run(
        [sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=True, timeout=300
    )
    assert out.stdout.splitlines()[-1] == "[]"


def test_pytest_enters_every_folder_of_tests(pytestconfig: pytest.Config) -> None:
    """By default pytest skips folders called `build` or `dist`."""
    folders = {path.parent for path in (ROOT / "tests").rglob("test_*.py")}
    names = {part for folder in folders for part in folder.relative_to(ROOT).parts}
    skipped = [name for name in names for pattern in pytestconfig.getini("norecursedirs") if fnmatch(name, pattern)]
    assert skipped == []
