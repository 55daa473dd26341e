"""Both forms of a result, JSON and text, and the conditions of options, for each subcommand of `metric-tree`."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from metric_base.errors import InputError
from metric_cli.subcommands import main
from metric_cli.subcommands.data import build
from metric_cli.subcommands.data.crawl import CrawlProgress
from metric_tree.checks.release_files import CODES
from metric_tree.tree import Tree
from taxonomy.matching.decisions import Decision, record_decision
from tests.synthetic import minitree


def printed(capsys: pytest.CaptureFixture[str], *words: str, status: int = 0) -> str:
    assert main(list(words)) == status
    captured = capsys.readouterr()
    return captured.err if status == 2 else captured.out


def test_codes_are_a_table_or_json(capsys: pytest.CaptureFixture[str]) -> None:
    table = printed(capsys, "validate", "--codes")
    assert [line.split()[0] for line in table.splitlines()[3:] if line] == sorted(CODES)
    assert json.loads(printed(capsys, "validate", "--codes", "--json")) == CODES


def test_a_version_is_validated_as_its_folder_is(
    mini: Tree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("METRIC_TREE_PATH", str(tmp_path / "releases"))
    folder = minitree.release(tmp_path / "releases" / "98.0.0").directory
    assert printed(capsys, "validate", "98.0.0").splitlines()[0].startswith(f"{folder}: ")


def test_a_search_without_a_match_is_an_error(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no node is called 'qqqq'" in printed(capsys, "search", "qqqq", "--tree", str(tree), status=2)
    rows = printed(capsys, "search", "mouse", "--tree", str(tree)).splitlines()
    assert rows[1].split() == ["node", "path", "tier", "items"]
    assert rows[3].startswith(" mouse.n.04")


def test_sizes_of_a_kind_are_printed_if_requested(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("query", "swivel chair", "--tree", str(tree))
    record = json.loads(printed(capsys, *words, "--kind", "product", "--json"))["items_of_kind"]
    text = printed(capsys, *words, "--kind", "product")
    assert f"mm; the {record['n']} shipped items of kind product" in text
    assert "of kind" not in printed(capsys, *words)
    assert "items_of_kind" not in json.loads(printed(capsys, *words, "--json"))


def test_parquet_and_json_exclude_each_other(tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.parquet"
    words = ("priors", "--tree", str(tree))
    assert "--json: expected it without" in printed(capsys, *words, "--parquet", str(out), "--json", status=2)
    assert not out.exists()
    assert printed(capsys, *words, "--parquet", str(out)) == ""
    assert out.read_bytes()[:4] == b"PAR1"
    rows = json.loads(printed(capsys, *words, "--json"))
    assert {row["node_id"] for row in rows} >= {"swivel_chair.n.01", "mouse.n.04"}


def test_a_publication_is_a_list_or_a_line(tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = json.loads(printed(capsys, "publish", str(tmp_path / "a"), "--tree", str(tree), "--json"))
    assert all(Path(file).is_file() for file in files)
    line = printed(capsys, "publish", str(tmp_path / "b"), "--tree", str(tree))
    assert line == f"{tmp_path / 'b'}: {len(files)} files\n"


def test_a_citation_has_the_sources_with_published_rows(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A source may have no number of rows."""
    manifest = json.loads((tree / "manifest.json").read_text())
    other = manifest["sources"][0] | {"id": "other", "n_fit": 0}
    shop = other | {"id": "shop", "n_rows": 3}
    manifest["sources"] = [shop, other | {"withheld": True}, other | {"id": "none", "n_rows": 0}]
    (tree / "manifest.json").write_text(json.dumps(manifest))
    record = json.loads(printed(capsys, "cite", "--tree", str(tree), "--json"))
    assert [row["id"] for row in record["sources"]] == ["shop"]
    assert (record["withheld"], record["noncommercial"]) == (["other"], [])
    text = printed(capsys, "cite", "--tree", str(tree))
    assert text.startswith(record["citation"])
    assert "published rows" in text


def test_a_downloaded_release_is_a_folder_or_a_record(
    mini: Tree, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = mini.release.directory
    monkeypatch.setattr("metric_cli.subcommands.release.fetch.fetch_release", lambda *_: folder)
    assert printed(capsys, "fetch", "1.0.0") == f"{folder}\n"
    assert json.loads(printed(capsys, "fetch", "1.0.0", "--json")) == {"version": "1.0.0", "path": str(folder)}


@pytest.mark.parametrize(("name", "is_valid"), [("a.org", True), ("*.a.org", True), ("*", True), ("a.*", False)])
def test_allowed_hosts_are_names_or_subdomains(
    name: str, is_valid: bool, tree: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served: list[Any] = []
    monkeypatch.setattr("uvicorn.run", lambda *_, **__: served.append(1))
    message = printed(capsys, "serve", "--tree", str(tree), "--allow-host", name, status=0 if is_valid else 2)
    assert (len(served), "--allow-host: expected a name" in message) == ((1, False) if is_valid else (0, True))


def test_tools_are_served_instead_of_http(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[str] = []
    server = SimpleNamespace(run=runs.append)
    monkeypatch.setitem(sys.modules, "explorer.server.mcp_server", SimpleNamespace(tool_server=lambda _: server))
    monkeypatch.setattr("uvicorn.run", lambda *_, **__: pytest.fail("an HTTP server"))
    assert main(["serve", "--mcp", "--tree", str(tree)]) == 0
    assert runs == ["stdio"]


@dataclass
class _Crawled:
    """Summary of a crawl of two sites."""

    error: str | None = None
    sites: dict[str, Any] = field(default_factory=lambda: {"a.org": {"pages": 3, "items": 1}, "b.org": {}})

    def record(self) -> dict[str, Any]:
        return {"schema": "metric-tree/crawl/1", "pages": 3, "dropped": {"no size": 2}, "sites": dict(self.sites)}


def test_a_crawl_is_two_tables_or_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("crawl", "generic", "--out", str(tmp_path / "c"), "--contact", "a@b.org")
    monkeypatch.setattr("crawler.fetch.crawl.run_crawl", lambda *_: _Crawled())
    assert json.loads(printed(capsys, *words, "--json")) == _Crawled().record()
    lines = [line.split() for line in printed(capsys, *words).splitlines()]
    assert ["dropped", "no", "size", "2"] in lines
    assert ["a.org", "pages", "3,", "items", "1"] in lines
    assert ["b.org", "none"] in lines
    assert not any("schema" in line for line in lines)
    monkeypatch.setattr("crawler.fetch.crawl.run_crawl", lambda *_: _Crawled("no page"))
    assert f"{tmp_path / 'c'}: no page" in printed(capsys, *words, status=2)


@pytest.mark.parametrize(("worker", "is_valid"), [("a-1.b", True), ("..", False), ("a b", False), ("", True)])
def test_a_worker_has_a_name_of_a_folder(
    worker: str, is_valid: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("crawler.fetch.crawl.run_crawl", lambda *_: _Crawled())
    words = ("crawl", "generic", "--out", str(tmp_path / "c"), "--contact", "a@b.org", "--worker", worker, "--json")
    assert ("--worker: expected a name" in printed(capsys, *words, status=0 if is_valid else 2)) == (not is_valid)


def test_progress_of_a_crawl_is_one_line_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with CrawlProgress() as show:
        assert show is None  # standard error is no terminal
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with CrawlProgress() as show:
        assert show is not None
        show({"metric_tree/pages": 5, "metric_tree/items": 2, "metric_tree/dropped/a": 1, "metric_tree/dropped/b": 2})
    shown = capsys.readouterr().err
    assert ", 2 items, 3 dropped, 0 waiting, 0 bans" in shown
    assert shown.endswith("\r\x1b[K")


@pytest.mark.parametrize(
    ("records", "warning"),
    [
        ([], "no raw item was taken"),
        ([("norms", "norm", 0, 5, 5, "")], "no raw item was taken"),
        ([("shop", "product", 3, 3, 0, "")], "withheld, for want of a declared open licence: all rows of shop"),
        ([("shop", "product", 3, 3, 1, "")], ""),
        ([("shop", "product", 3, 3, 0, "https://shop.org")], ""),
    ],
)
def test_a_build_warns_of_what_it_omits(
    records: list[tuple[Any, ...]], warning: str, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ("id", "kind", "n_fit", "n_items", "n_rows", "url")
    sources = [dict(zip(names, record, strict=True)) | {"withheld": True} for record in records]
    made: Any = SimpleNamespace(release=SimpleNamespace(manifest={"sources": sources}), log=Path("log"))
    build.warn_of_omissions(made)
    error = capsys.readouterr().err
    assert warning in error
    assert bool(error) == bool(warning)
    made.release.manifest["carried"] = "1.0.0"
    build.warn_of_omissions(made)
    assert capsys.readouterr().err == ""


def test_models_of_a_check_are_files_or_a_list(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "expected FILE... or --batch LIST; found neither" in printed(capsys, "check-asset", status=2)
    assert "expected MODEL --category NAME, or --batch TABLE" in printed(capsys, "true-size", status=2)


@pytest.mark.parametrize(
    ("verdict", "factor", "true_factor", "written", "warning"),
    [
        ("wrong unit", 0.01, None, 0.01, ""),
        ("arbitrary scale", None, (1.0, 2.0, 3.0), 2.0, ""),
        ("arbitrary scale", None, None, None, "arbitrary scale says no factor"),
        ("stretched", None, None, None, "stretched says no factor"),
        ("right", None, None, None, ""),
    ],
)
def test_wrong_models_are_written_at_their_factor(
    verdict: str,
    factor: float | None,
    true_factor: tuple[float, float, float] | None,
    written: float | None,
    warning: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from metric_cli.subcommands.models.check_asset import write_fixed

    factors: list[float] = []
    monkeypatch.setattr("models3d.rescaling.write_at_scale", lambda _, __, factor, baked: factors.append(factor))
    true_size = None if true_factor is None else SimpleNamespace(factor=true_factor)
    check: Any = SimpleNamespace(
        verdict=verdict, factor=factor, true_size=true_size, file="a.glb", is_wrong=verdict != "right"
    )
    assert write_fixed(SimpleNamespace(file=Path("a.glb")), [check], Path("out.glb"), None, False)  # type: ignore[arg-type]
    assert factors == ([] if written is None else [written])
    assert warning in (error := capsys.readouterr().err)
    assert bool(error) == bool(warning)


def test_a_model_that_cannot_be_written_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from metric_cli.subcommands.models.check_asset import write_fixed

    def refuse(*_: Any, **__: Any) -> None:
        raise InputError("a.glb: no room")

    monkeypatch.setattr("models3d.rescaling.write_at_scale", refuse)
    check: Any = SimpleNamespace(verdict="wrong unit", factor=0.1, true_size=None, file="a.glb", is_wrong=True)
    assert not write_fixed(SimpleNamespace(file=Path("a.glb")), [check], Path("out.glb"), None, False)  # type: ignore[arg-type]
    assert "a.glb: no room" in capsys.readouterr().err


def test_readings_are_tables_or_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, concept in (("Ada", "chair.n.01"), ("Grace", "stool.n.01")):
        read = Decision(what="match", subject="*: foo", decision=concept, reviewer=name, when="2026-01-01T00:00Z")
        record_decision(read, tmp_path / "recorded.jsonl")
    words = ("review", "agreement", "--folder", str(tmp_path))
    found = json.loads(printed(capsys, *words, "--json"))
    assert found["agreement"]["match"]["n"] == 1
    assert found["differ"] == [{"what": "match", "subject": "*: foo", "first": "chair.n.01", "second": "stool.n.01"}]
    text = printed(capsys, *words)
    assert "1 go to a third reviewer" in text
    assert "0.000" in text
    assert "words that wait" not in printed(capsys, "review", "list", "--folder", str(tmp_path))


def test_a_form_has_at_least_one_node(tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.html"
    words = ("review", "proof", "--tree", str(tree), "--out", str(out))
    assert "--limit: expected a number from 1" in printed(capsys, *words, "--limit", "0", status=2)
    assert json.loads(printed(capsys, *words, "--limit", "1", "--json"))["page"] == str(out)
    assert str(out) in printed(capsys, *words, "--overwrite")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--contact", "nobody"], "--contact: expected a mail address or a page's URL"),
        (["--contact", ""], "found none"),
        (["--contact", "a@b.org\x07"], "--contact: expected a mail address"),
        (["--contact", "https://a.org/bot"], None),
        (["--contact", "A B <a@b.org>"], None),
        (["--limit", "0"], "--limit: expected 1 or more items; found 0"),
        (["--limit", "1"], None),
        (["--delay", "-0.1"], "--delay: expected 0 or more seconds"),
        (["--delay", "inf"], "--delay: expected 0 or more seconds"),
        (["--delay", "0"], None),
    ],
)
def test_options_of_a_crawl_are_checked_before_it_starts(
    options: list[str],
    message: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    crawls: list[Any] = []

    def run_crawl(crawl: Any, _: object) -> _Crawled:
        crawls.append(crawl)
        return _Crawled()

    monkeypatch.setattr("crawler.fetch.crawl.run_crawl", run_crawl)
    words = ["crawl", "generic", "--out", str(tmp_path / "c"), "--contact", "a@b.org", *options]
    text = printed(capsys, *words, status=0 if message is None else 2)
    assert len(crawls) == (message is None)
    assert message is None or message in text
    assert not crawls or crawls[0].limit == ("--limit" in options)
    (tmp_path / "file").touch()
    assert "expected a folder; found the file" in printed(capsys, *words[:2], "--out", str(tmp_path / "file"), status=2)


@dataclass
class _Source:
    """Declaration of an open data set."""

    id: str
    files: tuple[str, ...] = ()
    excluded: bool = False
    ship: bool = True
    fetch: str = "by hand"


def _import(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str, status: int = 0
) -> tuple[str, list[str]]:
    """The output of `import` for three sources, and the ids of those that are imported."""
    declared = [_Source("a", files=("x",)), _Source("b"), _Source("c", excluded=True, ship=False)]
    imported: list[str] = []

    def import_source(one: _Source, _: object) -> Any:
        imported.append(one.id)
        return SimpleNamespace(id=one.id, items=(SimpleNamespace(line=lambda: "{}"),))

    for name, value in {
        "sources": lambda _: declared,
        "source": lambda name, _: next(one for one in declared if one.id == name),
        "source_folder": lambda *_: None,
        "import_source": import_source,
        "changed_files": lambda *_: ["a.csv"],
        "write_import": lambda _result, file, _option: (file.parent.mkdir(exist_ok=True), file.touch()),
        "summary": lambda result: {"source": result.id, "rows": 2, "items": 1, "sampled_out": 0, "refused": 1,
                                   "reasons": {"no size": 1}},
        "terms": lambda one: {"source": one.id, "kind": "", "licence": "", "ship": one.ship, "url": "",
                              "downloads": "yes" if one.files else "no", "reason": f"reason of {one.id}"},
    }.items():  # fmt: skip
        monkeypatch.setattr(f"metric_cli.subcommands.data.import_.{name}", value)
    assert main(["import", *words]) == status
    captured = capsys.readouterr()
    return captured.out + captured.err, imported


def test_sources_without_files_are_left_out_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, imported = _import(monkeypatch, capsys, "--all", "--input", str(tmp_path), "--out", str(tmp_path / "raw"))
    assert imported == ["a", "c"]
    assert "b: no folder of this name" in text
    assert "a.csv: sha256: expected that declared for a" in text
    assert sorted(path.name for path in (tmp_path / "raw").iterdir()) == ["a.jsonl", "c.jsonl"]
    (tmp_path / "b").mkdir()
    assert _import(monkeypatch, capsys, "--all", "--input", str(tmp_path))[1] == ["a", "b", "c"]
    text, imported = _import(monkeypatch, capsys, "--all")
    assert imported == ["a", "b", "c"]
    assert "sha256" not in text


def test_one_source_is_imported_into_a_file_or_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _import(monkeypatch, capsys, "b", "--out", str(tmp_path / "x.jsonl"))
    _import(monkeypatch, capsys, "b", "--out", str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.jsonl", "x.jsonl"]
    text, _ = _import(monkeypatch, capsys, "b")
    assert text.split() == [*["source", "rows", "items", "sampled_out", "refused", "reasons"], text.split()[6],
                            "b", "2", "1", "0", "1", "no", "size", "1"]  # fmt: skip
    for words, found in (((), "neither"), (("b", "--all"), "both, b and --all")):
        assert f"expected one source, or --all; found {found}" in _import(monkeypatch, capsys, *words, status=2)[0]
    for words in (("--all", "--overwrite", "--out"), ("b", "--ship")):
        found = str(tmp_path / "x.jsonl")
        assert "expected a folder; found the file" in _import(monkeypatch, capsys, *words, found, status=2)[0]


def test_only_sources_that_may_be_redistributed_are_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _import(monkeypatch, capsys, "--all", "--ship", str(tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.jsonl.gz", "b.jsonl.gz"]


@pytest.mark.parametrize(("options", "reasons"), [((), "bc"), (("--verbose",), "abc")])
def test_a_list_of_sources_has_reasons_for_those_that_cannot_be_downloaded(
    options: tuple[str, ...], reasons: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text, imported = _import(monkeypatch, capsys, "--list", *options)
    assert [name for name in "abc" if f"reason of {name}" in text] == [*reasons]
    assert imported == []


@pytest.mark.parametrize(
    ("backend", "has_weights", "download", "expected"),
    [
        ("plain", True, False, ("plain", False)),
        ("auto", True, False, ("auto", True)),
        ("auto", False, False, ("auto", False)),
        ("auto", False, True, ("auto", True)),
        ("rembg", True, False, ("rembg", True)),
        ("rembg", False, True, ("rembg", True)),
        ("rembg", False, False, None),
    ],
)
def test_weights_of_a_backend_are_found_or_downloaded(
    backend: str,
    has_weights: bool,
    download: bool,
    expected: tuple[str, bool] | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from metric_cli.subcommands.training.cutout import backend_settings

    loaded: list[str] = []
    monkeypatch.setattr("metric_tree.cutouts.network.has_weights", lambda _: has_weights)
    monkeypatch.setattr("metric_tree.cutouts.network.Network.load", loaded.append)
    if expected is None:
        with pytest.raises(InputError, match="expected rembg and its weights on this machine"):
            backend_settings(backend, "u2net", download)
        return
    settings = backend_settings(backend, "u2net", download)
    assert settings.name == expected[0]
    assert settings.weights == expected[1]
    assert loaded == ["u2net"] * (download and not has_weights)
    assert ("only plain backgrounds are cut" in capsys.readouterr().err) == (expected == ("auto", False))


def test_a_row_of_a_batch_has_the_result_or_the_last_line_of_the_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from metric_cli.batch import BatchCommand, scene_row

    answers: list[tuple[int, str, str]] = [
        (0, '{"a": 1}', "x: working\n"),
        (2, '{"a": 1}', "x: reading\nx: a.jpg: no image\n"),
        (0, "", "warning\nlast words\n"),
        (3, "{}", ""),
    ]

    def run(argv: list[str]) -> int:
        assert argv == ["p", "scene", "--json"]
        status, out, error = answers.pop(0)
        sys.stdout.write(out)
        sys.stderr.write(error)
        return status

    monkeypatch.setitem(sys.modules, "fake_command", SimpleNamespace(main=run))
    monkeypatch.chdir(tmp_path)
    command = BatchCommand("x", "fake_command", ("p",), argparse.ArgumentParser, lambda text: {"status": text})
    scene: Any = SimpleNamespace(name="scene\x07", words=("scene",))
    rows = [scene_row(command, tmp_path, scene) for _ in range(4)]
    assert [(row.get("status"), row["exit_status"], row["error"], row.get("result")) for row in rows] == [
        ('{"a": 1}', 0, None, '{"a": 1}'),
        (None, 2, "a.jpg: no image", None),
        (None, 0, "last words", None),
        ("{}", 3, None, "{}"),
    ]
    assert rows[0]["scene"] == "scene\\x07"


def test_columns_of_batches() -> None:
    from metric_cli.estimate_scale.estimate import batch_columns as of_scene
    from metric_cli.insert_object.insert import batch_columns as of_insertion
    from metric_cli.subcommands.models.check_asset import batch_columns as of_model

    interval = {"low": 0.4, "high": 0.6}
    resolved = {"status": "resolved", "scale": 0.5, "interval": interval}
    assert of_scene(json.dumps(resolved)) == {"status": "resolved", "scale": 0.5, **interval, "error": None}
    failed = {"status": "unresolved", "interval": None, "failure": {"message": "no texture"}}
    nothing = {"scale": None, "low": None, "high": None}
    assert of_scene(json.dumps(failed)) == {"status": "unresolved", **nothing, "error": "no texture"}
    inserted = {"scale": {"metres_per_unit": 0.5, **interval}}
    assert of_insertion(json.dumps(inserted)) == {"status": "inserted", "scale": 0.5, **interval}

    def models(*verdicts: str) -> dict[str, Any]:
        rows = [{"verdict": verdict, "factor": float(k)} for k, verdict in enumerate(verdicts)]
        return of_model("\n".join(map(json.dumps, rows)))

    assert models("right", "not known", "wrong unit") == {"status": "wrong unit", "scale": 2.0}
    assert models("not known", "right") == {"status": "not known", "scale": 0.0}
