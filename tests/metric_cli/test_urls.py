"""Inputs and outputs at URLs, on an S3 server on loopback in another process, with a proxy that adds faults."""

from __future__ import annotations

import gzip
import json
from functools import partial
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import metric_cli.subcommands.data.build as command
from metric_base import remote
from metric_cli.estimate_scale.estimate import main as estimate_scale
from metric_cli.subcommands import main
from metric_tree.pipeline import ingest
from metric_tree.pipeline.build import build_release
from tests.support.s3_server import faulty_proxy, s3_server
from tests.synthetic import minitree
from tests.synthetic.raw_fixture import SOURCES, synthetic_items, written
from tests.synthetic.small_scene import write_small_scene
from tests.synthetic.small_taxonomy import small_taxonomy

SCENES = [(0, "scenes/colmap"), (1, "none")]
SECRET = "not-a-real-secret-5f1d"


@pytest.fixture(scope="module")
def server():
    with s3_server() as port:
        yield port


@pytest.fixture
def store(server, tmp_path, monkeypatch):
    """A file system of the server with an empty bucket; commands find the server and the key in the environment."""
    import s3fs

    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "id")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", SECRET)
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "cache"))
    use_port(monkeypatch, server)
    system = s3fs.S3FileSystem(endpoint_url=f"http://127.0.0.1:{server}", use_listings_cache=False)
    if system.exists("bucket"):
        system.rm("bucket", recursive=True)
    system.mkdir("bucket")
    return system


def use_port(monkeypatch, port: int) -> None:
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(command, "build_release", partial(build_release, taxonomy=small_taxonomy))
    monkeypatch.setattr(command, "declared_sources", lambda _: SOURCES)
    monkeypatch.setattr(command, "shipped_curated", tuple)
    monkeypatch.setattr(ingest, "BLOCK_BYTES", 20_000)
    monkeypatch.setattr(remote, "REQUEST_BYTES", 8_192)


def files_of(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(directory.iterdir())}


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_a_build_from_and_to_s3_has_the_bytes_of_a_local_one(
    store, server, small, tmp_path, monkeypatch, capfd, suffix
):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    if suffix:
        raw = raw.rename(tmp_path / "raw.jsonl.gz")
        raw.write_bytes(gzip.compress(raw.read_bytes()))
    more = ("--created", "2026-01-02", "--workers", "1", "--no-heldout")
    assert main(["build", str(raw), "--out", str(tmp_path / "local"), *more]) == 0
    store.put_file(str(raw), f"bucket/raw/raw.jsonl{suffix}")
    with faulty_proxy(server, every=9) as (port, faults):
        use_port(monkeypatch, port)
        assert main(["build", "s3://bucket/raw", "--out", "s3://bucket/out/release", *more]) == 0
    assert {"error", "cut", "slow"} <= set(faults)
    use_port(monkeypatch, server)
    store.get("bucket/out/release", str(tmp_path / "copy"), recursive=True)
    assert files_of(tmp_path / "copy") == files_of(tmp_path / "local")
    assert store.exists("bucket/out/release.build/report.json")
    assert not list((tmp_path / "cache").rglob("*.parquet"))  # nothing is left here
    printed = capfd.readouterr()
    everything = printed.out + printed.err + "".join(map(str, files_of(tmp_path / "copy").values()))
    assert SECRET not in everything
    assert main(["build", "s3://bucket/raw", "--out", "s3://bucket/out/release", *more]) == 2
    assert "--out: s3://bucket/out/release already exists" in capfd.readouterr().err


def test_the_manifest_is_uploaded_last(store, small, tmp_path, monkeypatch):
    order = []
    put = type(store).put_file
    monkeypatch.setattr(type(store), "put_file", lambda self, a, b, **more: order.append(b) or put(self, a, b, **more))
    store.pipe_file("bucket/raw.jsonl", written(tmp_path / "raw.jsonl", synthetic_items()).read_bytes())
    assert main(["build", "s3://bucket/raw.jsonl", "--out", "s3://bucket/release", "--workers", "1"]) == 0
    assert order[-1] == "s3://bucket/release/manifest.json"
    assert sum("manifest" in name for name in order) == 1
    assert order[0].startswith("s3://bucket/release.build/")


def test_a_store_that_refuses_the_output_leaves_it_here(store, small, tmp_path, monkeypatch, capsys):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    refuse = lambda *_, **__: (_ for _ in ()).throw(PermissionError("denied"))  # noqa: E731
    monkeypatch.setattr(type(store), "put_file", refuse)
    assert main(["build", str(raw), "--out", "s3://bucket/release", "--workers", "1"]) == 2
    line = capsys.readouterr().err
    folder = Path(line.rpartition("the output is in ")[2].strip())
    assert (folder / "release" / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("s3://bucket/none", "--out", "x"), "s3://bucket/none: expected an existing file or folder; found none"),
        (("s3://nobucket/a", "--out", "x"), "s3://nobucket/a: expected"),
        (("x.jsonl", "--out", "x", "--log", "s3://bucket/log"), "--log: expected a local folder"),
    ],
)
def test_bad_urls_are_one_line(store, tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(["build", *words]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1


def test_credentials_in_a_url_are_refused_and_not_printed(tmp_path, capsys):
    url = f"s3://id:{SECRET}@bucket/raw"
    assert main(["build", url, "--out", str(tmp_path / "x")]) == 2
    printed = capsys.readouterr().err
    assert "expected a URL without credentials" in printed
    assert SECRET not in printed


@pytest.mark.parametrize(("scheme", "library"), remote.LIBRARIES.items())
def test_a_missing_library_is_named_by_its_extra(scheme, library, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert main(["build", f"{scheme}://bucket/raw", "--out", str(tmp_path / "x")]) == 2
    assert f"needs metric-tree[{scheme}]: pip install" in capsys.readouterr().err


def test_a_file_url_is_a_path(tmp_path, capsys):
    folder = minitree.release(tmp_path / "my release")
    assert main(["query", "chair", "--tree", folder.directory.as_uri(), "--json"]) == 0
    with_url = capsys.readouterr().out
    assert main(["query", "chair", "--tree", str(folder.directory), "--json"]) == 0
    assert capsys.readouterr().out == with_url


def test_a_release_at_a_url_answers_queries(store, tmp_path, capsys):
    folder = minitree.release(tmp_path / "release").directory
    store.put(str(folder), "bucket/releases/", recursive=True)
    assert main(["query", "chair", "--tree", "s3://bucket/releases/release", "--json"]) == 0
    with_url = capsys.readouterr().out
    assert main(["query", "chair", "--tree", str(folder), "--json"]) == 0
    assert capsys.readouterr().out == with_url
    assert remote._FETCHED == {}


@pytest.mark.slow
def test_scenes_of_a_batch_and_their_results_at_urls(store, tmp_path, capsys):
    """A scene is read from a URL, its result and the table of the batch are written to URLs; nothing remains here."""
    write_small_scene(tmp_path / "small")
    store.put(str(tmp_path / "small" / "colmap"), "bucket/scenes/", recursive=True)
    rows = ["scene,instances,output"]
    rows += [
        f"s3://bucket/{name},s3://bucket/scenes/colmap/instances.json,s3://bucket/{number}.json"
        for number, name in SCENES
    ]
    (tmp_path / "list.csv").write_text("\n".join(rows), encoding="utf-8")
    words = ["--batch", str(tmp_path / "list.csv"), "--out", "s3://bucket/results.parquet", "--jobs", "1"]
    assert estimate_scale(words) == 2
    assert "s3://bucket/none: expected an existing file or folder; found none" in capsys.readouterr().err
    store.get_file("bucket/results.parquet", str(tmp_path / "results.parquet"))
    table = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [(row["scene"], row["exit_status"] in (0, 3)) for row in table] == [
        ("s3://bucket/scenes/colmap", True),
        ("s3://bucket/none", False),
    ]
    assert json.loads(store.cat_file("bucket/0.json"))["schema"].startswith("metric-tree/scale/")
    assert not store.exists("bucket/1.json")
    assert estimate_scale([*words[:-2], "--overwrite"]) == 2
