"""The build: accepted and refused input, equal results of equal runs, and resumption."""

from __future__ import annotations

import gzip
import json
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from crawler.items import RawItem
from metric_base.errors import InputError
from metric_base.files import sole_writer
from metric_base.remote import StoreError
from metric_tree.checks.release_files import findings
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.fit.rows import EVIDENCE
from metric_tree.pipeline import build as build_module
from metric_tree.pipeline import clean, ingest, shards
from metric_tree.pipeline.build import BuildOptions, build_release, ingest_part
from metric_tree.pipeline.clean import short_title
from metric_tree.pipeline.ingest import is_held_out, widened_sd
from metric_tree.tree import open_tree
from tests.support import small_build
from tests.support.processes import started
from tests.synthetic.raw_fixture import SOURCES, TYPICAL, synthetic_items, written
from tests.synthetic.small_taxonomy import small_taxonomy

OPTIONS = BuildOptions(version="0.0.1", created="2026-11-21", heldout=False)


def build(raw, out: Path, options: BuildOptions = OPTIONS, **more):
    return build_release([raw], out, options, taxonomy=small_taxonomy, declared=SOURCES, **more)


def quarantined(out: Path) -> list[dict]:
    lines = out.with_name(f"{out.name}.build") / "quarantine.jsonl"
    return [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()]


def files_of(directory: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(directory.iterdir())}


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    folder = tmp_path_factory.mktemp("build")
    return build(written(folder / "raw.jsonl", synthetic_items()), folder / "release").release


def test_release_is_valid_and_holds_the_sizes(release):
    assert [finding for finding in findings(release.directory) if finding.is_error] == []
    tree = open_tree(release.directory)
    for name, typical in TYPICAL.items():
        node = tree.find(name)
        if node.pose != "any":
            assert node.dims == ("length", "width", "height")
        expected = sorted(typical, reverse=True)
        assert sorted(node.prior().quantile(0.5), reverse=True) == pytest.approx(expected, rel=0.15)
    assert tree.find("ball").dims == ("extent1", "extent2", "extent3")
    assert tree.find("furniture").n_items == sum(tree.find(name).n_items for name in ("chair", "stool", "sofa", "desk"))
    assert tree.find("stool").prior().borrowed > 0.5
    assert tree.find("chair").prior().n_sources == 3  # the games' models are silent next to so many products


def test_evidence_is_counted_from_the_weakest_to_the_strongest(release):
    counts, whole = release.manifest["evidence"], release.manifest["counts"]
    assert counts["any"]["items"] == whole["n_fit"] > counts["strong"]["items"] > 0
    assert all(counts["any"][f"leaves_{n}"] == whole[f"leaves_{n}"] for n in (1, 10, 30))
    assert EVIDENCE["any"] == {"product", "measured", "standard", "asset", "museum", "default"}
    assert EVIDENCE["physical"] - EVIDENCE["strong"] == {"museum"}


def test_rows_without_an_open_licence_are_used_and_not_shipped(release):
    sources = {record["id"]: record for record in release.manifest["sources"]}
    assert sources["shop"]["withheld"]
    assert sources["shop"]["n_fit"] > 0
    assert sources["shop"]["n_rows"] == 0
    assert sources["lab"]["n_rows"] == sources["lab"]["n_fit"] > 0
    items = release.table("items")
    assert set(items["source"].to_pylist()) == {"lab", "games"}
    assert set(items["licence"].to_pylist()) == {"CC0-1.0"}


def test_items_name_whom_to_credit_and_nodes_their_sources(tmp_path, release):
    assert set(release.table("items")["attribution"].to_pylist()) == {"the tests"}
    first, *others = [item for item in synthetic_items() if item.source == "lab"]
    items = [replace(first, attribution="Ada"), *others]
    again = build(written(tmp_path / "raw.jsonl", items), tmp_path / "again").release.table("items").to_pylist()
    assert {row["attribution"] for row in again if row["item_id"] == first.identity} == {"Ada"}
    tree = open_tree(release.directory)
    assert tree.find("chair").sources == tree.find("furniture").sources == ("club", "games", "lab", "shop")
    assert release.manifest["basis"].startswith("The priors of 0.0.1 are fitted to")


@pytest.mark.parametrize(
    ("title", "short"),
    [
        ("one two three four five six seven eight", "one two three four five six seven eight"),
        ("one two three four five six seven eight nine", "one two three four five six seven eight"),
        ("A7 desk lamp - with a dimmer and a clamp", "A7 desk lamp"),
        ("Lamp, with a dimmer and a clamp of steel", "Lamp, with a dimmer and a clamp of"),
        ("Pro headset of full size in black with cable", "Pro headset of full size in black"),
    ],
)
def test_titles_of_products_have_at_most_eight_words(title, short):
    assert short_title(title) == short


def test_the_same_input_gives_the_same_bytes_whatever_the_workers(tmp_path, release):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        again = build(raw, tmp_path / "again", executor=pool).release
    assert files_of(again.directory) == files_of(release.directory)


def test_folders_and_gzip_are_read_as_files_are(tmp_path, release):
    items = synthetic_items()
    written(tmp_path / "raw" / "a.jsonl", items[:50])
    (tmp_path / "raw" / "a.quarantine.jsonl").write_text('{"reason": "no raw item"}\n')
    with gzip.open(tmp_path / "raw" / "b.jsonl.gz", "wt", encoding="utf-8") as file:
        file.writelines(item.line() + "\n" for item in items[50:])
    again = build(tmp_path / "raw", tmp_path / "again").release
    assert files_of(again.directory) == files_of(release.directory)


def test_a_fold_is_left_out_and_nothing_else(tmp_path):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    whole = build(raw, tmp_path / "whole").release.table("items")["item_id"].to_pylist()
    folds = []
    for fold in range(3):
        left = build(raw, tmp_path / f"fold{fold}", replace(OPTIONS, fold_out=(fold, 3))).release
        kept = left.table("items")["item_id"].to_pylist()
        assert not any(is_held_out(item_id, fold, 3) for item_id in kept)
        assert left.manifest["fold_out"] == [fold, 3]
        folds.append(set(whole) - set(kept))
    assert set().union(*folds) == set(whole)


def test_noncommercial_sources_can_be_left_out(tmp_path):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    release = build(raw, tmp_path / "free", replace(OPTIONS, noncommercial=False)).release
    assert "club" not in {record["id"] for record in release.manifest["sources"]}
    assert release.manifest["counts"]["raw"]["source_left_out"] > 0


def test_what_is_refused_is_kept_with_its_reason(tmp_path):
    items = synthetic_items()
    chair = items[1]
    wrong = [
        replace(chair, source_id="unknown", category_path=("objects", "gizmo")),
        replace(chair, source_id="empty", dimensions_mm={}, extents_mm=None),
        replace(chair, source_id="prose", flags=("low_trust",)),
        replace(chair, source_id="slip", dimensions_mm={"length": 52.0, "width": 48.0, "height": 88.0}),
        replace(chair, source_id="far", dimensions_mm={"length": 520.0, "width": 480.0, "height": 12345.0}),
        chair,  # the same id twice
        replace(items[0], source_id="copy", title="chair under another name"),
    ]
    out = tmp_path / "release"
    build(written(tmp_path / "raw.jsonl", [*items, *wrong]), out)
    found = {(record["source_id"], record["reason"]) for record in quarantined(out)}
    assert {
        ("unknown", "no_category"),
        ("empty", "no_size"),
        ("prose", "low_trust"),
        ("slip", "unit_slip"),
    } <= found
    assert ("far", "unit_slip") in found or ("far", "far_outlier") in found
    counts = open_tree(out).release.manifest["counts"]["raw"]
    assert counts["repeated_id"] == 1
    assert counts["duplicate"] >= 1
    assert "copy" in {source_id for source_id, reason in found if reason == "duplicate"}
    assert all(record["detail"] for record in quarantined(out) if record["reason"] in {"unit_slip", "duplicate"})


def test_curated_ranges_give_a_prior_where_there_is_nothing_else(tmp_path):
    def curated(name: str) -> RawItem:
        return RawItem(
            source="judged",
            source_id=name,
            category_path=(name,),
            dimensions_mm={"length": 400.0, "width": 350.0, "height": 450.0},
            ranges_mm={"length": (350.0, 450.0), "height": (400.0, 700.0)},
            kind="judged",
        )

    items = [item for item in synthetic_items() if item.category_path[-1] != "stool"]
    raw = written(tmp_path / "raw.jsonl", items)
    release = build(raw, tmp_path / "release", curated=[curated("stool"), curated("sofa")]).release
    tree = open_tree(release.directory)
    stool, prior = tree.find("stool"), tree.find("stool").prior()
    assert stool.n_items == prior.n == 0
    assert prior.share_by_kind == {"judged": 1.0}
    assert prior.quantile(0.5) == pytest.approx([400, 350, 450], rel=0.04)  # the bias of a range in the shipped model
    spread = prior.log_sd()
    for axis, low, high in ((0, 350, 450), (2, 400, 700)):
        believed = widened_sd(low, high)
        assert spread[axis] == pytest.approx(believed * NEW_SOURCE.factor(0, believed) ** 0.5, rel=0.01)
    sofa = tree.find("sofa").prior()  # a range far off is treated as one source of five
    assert 0 < sofa.share_by_kind["judged"] < 0.5
    assert 1000 < sofa.quantile(0.5)[0] < 2000  # the shipped model trusts a range more than this build's own would
    assert [finding for finding in findings(release.directory) if finding.is_error] == []
    assert next(r for r in release.manifest["sources"] if r["id"] == "judged")["n_fit"] == 0
    without = build(raw, tmp_path / "fold", replace(OPTIONS, fold_out=(0, 1)), curated=[curated("stool")]).release
    assert open_tree(without.directory).find("stool").prior().share_by_kind == {"judged": 1.0}  # a range is no item


def test_rows_are_made_again_without_the_withheld_sources(tmp_path, release):
    """Who has only the raw items that may be given on gets the same rows, and the priors that used the others."""
    shippable = [item for item in synthetic_items() if SOURCES[item.source].ship]
    raw = written(tmp_path / "raw.jsonl", shippable)
    again = build(raw, tmp_path / "again", carried=release).release
    for name in ("items.parquet", "nodes.parquet", "priors.parquet"):
        assert (again.directory / name).read_bytes() == (release.directory / name).read_bytes()
    assert again.manifest["carried"]["version"] == release.manifest["version"]
    assert again.manifest["sources"] == release.manifest["sources"]


def test_an_interrupted_build_leaves_no_release_and_takes_up_where_it_was(tmp_path, monkeypatch, release):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    real, calls = build_module.class_priors, []

    def failing(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(build_module, "class_priors", failing)
    with pytest.raises(KeyboardInterrupt):
        build(raw, tmp_path / "release")
    assert [path.name for path in tmp_path.iterdir() if "release" in path.name] == ["release.build"]
    done = []
    monkeypatch.setattr(build_module, "class_priors", lambda *a: done.append(a) or real(*a))
    monkeypatch.setattr(build_module, "ingest_block", None)  # would fail if called again
    monkeypatch.setattr(build_module, "clean_unit", None)
    again = build(raw, tmp_path / "release").release
    assert len(done) < build_module.SHARDS
    assert files_of(again.directory) == files_of(release.directory)
    assert sorted(path.name for path in (tmp_path / "release.build").iterdir()) == ["quarantine.jsonl", "report.json"]


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["ingest-*.pickle", "clean-*.pickle", "fit-*.pickle"])
def test_a_killed_build_with_two_processes_continues_to_the_same_bytes(tmp_path, release, pattern):
    """SIGKILL of the build as soon as a step has two completion marks; its workers end too."""
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    words = [sys.executable, "-m", "tests.support.small_build", str(raw), str(tmp_path / "release")]
    work = tmp_path / "release.build" / "work"
    with started(words) as process:
        until(lambda: process.poll() is not None or len(list(work.glob(pattern))) >= 2)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
    assert process.returncode == -signal.SIGKILL
    until(lambda: not any(Path(f"/proc/{child}/task").exists() for child in children))
    marks = set(work.glob("*.pickle"))
    assert marks
    with started(words) as process:
        pass
    assert process.returncode == 0
    assert files_of(tmp_path / "release") == files_of(release.directory)


def test_parts_at_the_same_time_and_a_last_build_have_the_bytes_of_one_process(tmp_path, monkeypatch):
    """Three parts of a folder with compressed and other files; the last build ingests nothing."""
    items, raw = synthetic_items(), tmp_path / "raw"
    written(raw / "a.jsonl", items[:40])
    written(raw / "b.jsonl", items[40:])
    for name, n in (("c", 7), ("d", 11)):
        (raw / f"{name}.jsonl.gz").write_bytes(gzip.compress(written(tmp_path / name, items[n : n + 30]).read_bytes()))
    expected = build(raw, tmp_path / "one").release.directory
    words = [sys.executable, "-m", "tests.support.small_build", str(raw), str(tmp_path / "release")]
    with ExitStack() as stack:
        parts = [stack.enter_context(started([*words, f"{part}/3"])) for part in (1, 2, 3)]
    assert [part.returncode for part in parts] == [0, 0, 0]
    work = tmp_path / "release.build" / "work"
    n_blocks = sum(
        -(-file.stat().st_size // small_build.BLOCK_BYTES) for file in (*raw.glob("*.jsonl"), *work.glob("*.jsonl"))
    )
    assert len(list(work.glob("ingest-*.arrow"))) == n_blocks > 4
    monkeypatch.setattr(build_module, "ingest_block", None)
    monkeypatch.setattr(ingest, "BLOCK_BYTES", small_build.BLOCK_BYTES)
    assert files_of(build(raw, tmp_path / "release").release.directory) == files_of(expected)
    assert not work.exists()


def test_a_build_whose_nodes_are_divided_has_the_same_items_and_sizes(tmp_path, monkeypatch, release):
    """Units of ten rows, of which the classes take 5 rows or `MAX_FIT_ROWS` of each source: here all."""
    monkeypatch.setattr(shards, "MAX_UNIT_ROWS", 10)
    monkeypatch.setattr(clean, "MAX_CLASS_ROWS", 5)
    divided = build(written(tmp_path / "raw.jsonl", synthetic_items()), tmp_path / "release").release
    assert divided.manifest["counts"] == release.manifest["counts"]
    assert divided.manifest["sources"] == release.manifest["sources"]
    items, expected = (
        one.table("items").sort_by([("node_id", "ascending"), ("item_id", "ascending")]) for one in (divided, release)
    )
    assert items.equals(expected)
    for row, other in zip(divided.table("priors").to_pylist(), release.table("priors").to_pylist(), strict=True):
        assert row["node_id"] == other["node_id"]
        assert np.allclose(np.ravel(row["means"]), np.ravel(other["means"]), atol=1e-6, equal_nan=True)


def test_a_part_of_another_build_is_refused(tmp_path):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    more = {"taxonomy": small_taxonomy, "declared": SOURCES}
    renamed = replace(OPTIONS, created="2026-11-22", version="0.0.2", name="other")  # the same work
    ingest_part([raw], tmp_path / "release", OPTIONS, (1, 2), **more)
    ingest_part([raw], tmp_path / "release", renamed, (2, 2), **more)
    with pytest.raises(InputError, match="found that of another one: remove it"):
        ingest_part([raw], tmp_path / "release", replace(OPTIONS, fold_out=(0, 2)), (2, 2), **more)
    assert list((tmp_path / "release.build" / "work").glob("ingest-*"))


def until(holds, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def test_a_store_that_fails_keeps_the_work(tmp_path, release, monkeypatch):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())

    def fail(*_):
        raise StoreError("s3://bucket/raw.jsonl: expected a store that can be used")

    monkeypatch.setattr(build_module, "repeated_rows", fail)
    with pytest.raises(StoreError):
        build(raw, tmp_path / "release")
    assert list((tmp_path / "release.build" / "work").glob("ingest-*.pickle"))
    monkeypatch.undo()
    monkeypatch.setattr(build_module, "ingest_block", None)
    assert files_of(build(raw, tmp_path / "release").release.directory) == files_of(release.directory)


def test_another_input_does_not_take_up_old_work(tmp_path, monkeypatch):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    monkeypatch.setattr(build_module, "clean_unit", None)
    with pytest.raises(TypeError):
        build(raw, tmp_path / "release")
    monkeypatch.undo()
    written(raw, synthetic_items(per_class=20))
    release = build(raw, tmp_path / "release").release
    assert release.manifest["counts"]["n_fit"] < 110


def test_sources_that_disagree_are_reported(tmp_path):
    items = synthetic_items()
    large = [
        replace(item, dimensions_mm={word: size * 1.5 for word, size in item.dimensions_mm.items() if size})
        if item.source == "club" and item.category_path[-1] == "sofa"
        else item
        for item in items
    ]
    report = build(written(tmp_path / "raw.jsonl", large), tmp_path / "release").report
    worst = report["disagreements"][0]
    assert worst["node_id"] == "sofa.n.01"
    assert worst["observed_sd"] > 0.15
    assert set(worst["means_mm"]) == set(SOURCES) - {"games"}  # models are silent next to many products


def _damaged(folder: Path) -> Path:
    (folder / "raw.jsonl.gz").write_bytes(gzip.compress(b"{}\n" * 1000)[:20])
    return folder / "raw.jsonl.gz"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "none.jsonl", "expected raw items"),
        (lambda folder: _text(folder, "not json\n"), r"raw\.jsonl:1: line: expected a JSON object"),
        (lambda folder: _text(folder, '{"schema": "other/1"}\n'), "schema: expected metric-tree/raw/1"),
        (lambda folder: _bytes(folder, b"\xff\xfe\n"), r"raw\.jsonl:1"),
        (
            lambda folder: _text(folder, synthetic_items()[0].line().replace('"year": 2000', f'"year": {10**30}')),
            "year: expected four digits at most",
        ),
        (_damaged, "expected gzip data"),
        (lambda folder: _packed(folder, b"\n" + b" " * (1 << 22)), r"gz:2: line: expected less than 1,048,576 bytes"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, make, message):
    with pytest.raises(InputError, match=message) as raised:
        build(make(tmp_path), tmp_path / "release")
    assert "\n" not in str(raised.value)
    assert not [entry for entry in tmp_path.iterdir() if not entry.name.startswith("raw")]


def test_a_release_is_never_overwritten(tmp_path):
    (tmp_path / "release").mkdir()
    with pytest.raises(InputError, match="already exists; expected a new path"):
        build(written(tmp_path / "raw.jsonl", synthetic_items()), tmp_path / "release")


def _packed(folder: Path, data: bytes) -> Path:
    (folder / "raw.jsonl.gz").write_bytes(gzip.compress(data))
    return folder / "raw.jsonl.gz"


def _text(folder: Path, text: str) -> Path:
    (folder / "raw.jsonl").write_text(text, encoding="utf-8")
    return folder / "raw.jsonl"


def _bytes(folder: Path, content: bytes) -> Path:
    (folder / "raw.jsonl").write_bytes(content)
    return folder / "raw.jsonl"


def test_a_second_build_of_one_output_says_so_and_stops(tmp_path):
    raw = written(tmp_path / "raw.jsonl", synthetic_items())
    with sole_writer(tmp_path / "release"):
        with pytest.raises(InputError, match="release: another run is writing this output"):
            build(raw, tmp_path / "release")
        assert not (tmp_path / "release").exists()
    with sole_writer(tmp_path / "release"):  # free again
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["raw.jsonl"]
