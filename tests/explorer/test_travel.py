"""Releases that travel: what changed, flat tables, a registry on a loopback server, a folder for a data hub."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import metric_tree
from metric_base.errors import InputError
from metric_cli.subcommands import main
from metric_tree.release.registry import REGISTRY_VARIABLE, fetch_release, registry_entry
from metric_tree.reports.diff import release_diff
from metric_tree.tree import Tree


def test_a_diff_names_what_changed_and_is_a_gate(trees: list[Tree], capsys: pytest.CaptureFixture[str]) -> None:
    new, old = trees
    diff = release_diff(old, new)
    assert diff.added == ["rat.n.01"]
    assert [one.node for one in diff.priors] == ["mt:bar_stool"]
    assert diff.priors[0].median == pytest.approx(-0.1813, abs=1e-3)  # exp(-.2) - 1
    assert diff.renamed == {"trackball.n.01": ("track ball", "trackball")}
    assert diff.items == {"made": (38, 40)}
    words = ["diff", str(old.release.directory), str(new.release.directory)]
    assert main([*words, "--json", "--fail-over", "0.01"]) == 1
    assert json.loads(capsys.readouterr().out)["priors"][0]["node"] == "mt:bar_stool"
    assert main([*words, "--fail-over", "0.5"]) == 0
    assert "mt:bar_stool" in capsys.readouterr().out
    assert main([*words, "--fail-over", "5"]) == 2
    assert main([*words, "--fail-over", repr(diff.share_moved)]) == 0
    assert main([*words, "--fail-over", repr(diff.share_moved * 0.999)]) == 1
    capsys.readouterr()
    assert main([*words, "--factor", "1.2"]) == 0
    assert "measured to measured        1" in capsys.readouterr().out
    assert main([*words, "--factor", "1.3"]) == 0
    assert "0 leaves moved" in capsys.readouterr().out
    assert main([*words, "--factor", "1"]) == 2


def test_items_that_moved_to_another_node_name_its_successor(trees: list[Tree]) -> None:
    assert release_diff(trees[0], trees[1]).removed == ["rat.n.01"]
    assert release_diff(trees[0], trees[1]).merged == {}


def test_a_release_names_the_successors_of_removed_ids(trees: list[Tree], tmp_path: Path) -> None:
    folder = tmp_path / "later"
    shutil.copytree(trees[1].release.directory, folder)
    rows = {"old_id": ["rat.n.01"], "release": ["0.0.2"], "node_id": ["trackball.n.01"]}
    pq.write_table(pa.table(rows), folder / "successors.parquet")
    assert release_diff(trees[0], metric_tree.tree.Tree(trees[1].release)).merged == {}
    assert release_diff(trees[0], metric_tree.tree.open_tree(folder)).merged == {"rat.n.01": "trackball.n.01"}


def test_flat_tables(trees: list[Tree], capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    tree = trees[0]
    frame = tree.to_pandas()
    assert isinstance(frame, pd.DataFrame)
    row = frame[frame.node_id == "mt:bar_stool"].iloc[0]
    assert row.height_q50_mm == pytest.approx(760, rel=1e-3)
    assert row.tier == tree.find("bar stool").tier
    assert main(["priors", "--vocabulary", "coco_80", "--csv", "--tree", str(tree.release.directory)]) == 0
    mouse = next(line for line in capsys.readouterr().out.splitlines() if line.startswith('"mouse"'))
    assert '"mouse.n.04"' in mouse
    out = tmp_path / "sizes.parquet"
    assert main(["priors", "--parquet", str(out), "--tree", str(tree.release.directory)]) == 0
    assert pq.read_table(out).num_rows == len(tree)
    assert main(["search", "swivel", "--json", "--tree", str(tree.release.directory)]) == 0
    assert json.loads(capsys.readouterr().out)[0]["node"] == "swivel_chair.n.01"


class _Server(SimpleHTTPRequestHandler):
    """Serves a folder with ranges; breaks off after `broken_after` bytes of a file once, if that is set."""

    broken_after: int | None = None
    asked: ClassVar[list[tuple[str, str | None]]] = []

    def do_GET(self) -> None:
        data = Path(self.translate_path(self.path)).read_bytes()
        wanted = self.headers.get("Range")
        self.asked.append((self.path, wanted))
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        self.send_response(206 if wanted else 200)
        self.send_header("Content-Length", str(len(data) - start))
        self.end_headers()
        cut = type(self).broken_after
        if cut is not None and self.path.endswith("items.parquet"):
            type(self).broken_after = None
            self.wfile.write(data[start : start + cut])
            self.wfile.flush()
            self.connection.close()
            return
        self.wfile.write(data[start:])

    def log_message(self, *_: Any) -> None:
        """Nothing on the terminal."""


def test_a_release_is_fetched_verified_resumed_and_then_offline(
    trees: list[Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "host"
    folder.mkdir()
    (folder / "0.0.2").symlink_to(trees[0].release.directory)
    files = registry_entry(trees[0].release.directory)
    record = {
        "schema": "metric-tree/registry/1",
        "releases": {"0.0.2": files, "0.0.3": {**files, "nodes.parquet": "0" * 64}},
    }
    (folder / "0.0.3").symlink_to(trees[0].release.directory)
    (folder / "registry.json").write_text(json.dumps(record))
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "cache"))
    _Server.broken_after, _Server.asked = 1000, []
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Server, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setenv(REGISTRY_VARIABLE, f"http://127.0.0.1:{server.server_port}/registry.json")
        try:
            with pytest.raises(InputError, match=r"items\.parquet"):
                fetch_release("0.0.2")  # the connection breaks off
            tree = metric_tree.open("0.0.2")
            with pytest.raises(InputError, match="sha256"):
                fetch_release("0.0.3")
            with pytest.raises(InputError, match=r"expected one of 0\.0\.2, 0\.0\.3"):
                metric_tree.open("9.9.9")
        finally:
            server.shutdown()
    assert ("/0.0.2/items.parquet", "bytes=1000-") in _Server.asked
    assert tree.find("rat").items().num_rows == 2
    assert metric_tree.open("0.0.2").version == "0.0.2"  # the server is gone
    monkeypatch.delenv(REGISTRY_VARIABLE)
    with pytest.raises(InputError, match="expected an available version"):
        metric_tree.open("9.9.9")


@pytest.mark.parametrize("name", ["../evil", "/etc/passwd", "a//b"])
def test_a_registry_leads_nowhere_else(tmp_path: Path, name: str) -> None:
    sums = {"manifest.json": "0" * 64, name: "0" * 64}
    file = tmp_path / "registry.json"
    file.write_text(json.dumps({"schema": "metric-tree/registry/1", "releases": {"1.0.0": sums}}))
    with pytest.raises(InputError, match="schema"):
        fetch_release("1.0.0-x", str(file))


def test_a_registry_without_end_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "registry.json").write_text("[" * 200_000)
    with pytest.raises(InputError, match="expected a registry of releases"):
        fetch_release("1.0.0-x", str(tmp_path / "registry.json"))


def test_a_publication_is_read_by_the_tools_of_data_hubs(trees: list[Tree], tmp_path: Path) -> None:
    out = tmp_path / "publication"
    assert main(["publish", str(out), "--tree", str(trees[0].release.directory)]) == 0
    sums = dict(line.split("  ")[::-1] for line in (out / "SHA256SUMS").read_text().splitlines())
    files = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert set(sums) == files - {"SHA256SUMS"}
    assert all(hashlib.sha256((out / name).read_bytes()).hexdigest() == checksum for name, checksum in sums.items())
    assert main(["publish", str(out)]) == 2

    import mlcroissant
    import pandas as pd
    import pyarrow.dataset

    dataset = mlcroissant.Dataset(jsonld=str(out / "croissant.json"))
    assert dataset.metadata.issues.errors == set()
    for name, rows in (("nodes", 15), ("items", 40), ("sizes", 18), ("priors", 6)):
        assert len(list(dataset.records(name))) == rows
        assert pd.read_parquet(out / name).shape[0] == pyarrow.dataset.dataset(out / name).count_rows() == rows
    sizes = pd.read_parquet(out / "sizes")
    for row in sizes.to_dict("records"):
        prior = trees[0].node(row["node"]).prior((row["axis"],))
        assert [row["q05"], row["q50"], row["q95"]] == pytest.approx(prior.quantiles((0.05, 0.5, 0.95))[:, 0], rel=1e-4)
    assert pd.read_parquet(out / "items")["attribution"].notna().all()

    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    import datasets

    for name, rows in ((None, 18), ("items", 40), ("priors", 6)):
        assert datasets.load_dataset(str(out), name, split="train", cache_dir=str(tmp_path / "cache")).num_rows == rows


def test_releases_without_a_difference_have_an_empty_diff(trees: list[Tree]) -> None:
    diff = release_diff(trees[0], trees[0])
    assert (diff.items, diff.licences, diff.added, diff.removed, diff.priors) == ({}, {}, [], [], [])
