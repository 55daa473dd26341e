"""`metric-tree cutout` as it is typed: a new release, hostile files, an interruption, missing weights, a cluster."""

from __future__ import annotations

import json
import os
from io import BytesIO

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

import metric_tree
import metric_tree.cutouts.release_cutouts as module
from metric_cli.subcommands import main
from metric_tree.checks.release_files import findings
from metric_tree.cutouts.backend import Guide, Settings
from metric_tree.cutouts.release_cutouts import TABLE, cut, cut_release
from metric_tree.release.release import sha256
from tests.synthetic.hostile_pictures import HOSTILE as MAKERS
from tests.synthetic.hostile_pictures import encoded, shop_picture
from tests.synthetic.picture_fixture import HOSTILE, release_with, wallpaper

PLAIN = Settings("plain")


@pytest.fixture
def no_weights(tmp_path, monkeypatch):
    monkeypatch.setenv("U2NET_HOME", str(tmp_path / "nowhere"))


def run(*words):
    return main(["cutout", *map(str, words), "--workers", "1"])


def rows(directory):
    return {row["image_id"]: row for row in pq.read_table(directory / TABLE).to_pylist()}


def test_a_release_with_cutouts_is_another_release(tmp_path, no_weights, capsys):
    old = release_with(tmp_path / "old", [shop_picture(0), shop_picture(1), wallpaper()])
    before = sha256(old.directory / "images.parquet")
    assert run(old.directory, "--out", tmp_path / "new", "--json") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["cut"] == {"plain": 2}
    assert json.loads(printed.out)["set_aside"] == {"no_weights": 1}
    assert printed.err == "metric-tree cutout: no weights of u2net here: only plain backgrounds are cut\n"
    assert sha256(old.directory / "images.parquet") == before
    assert not [finding for finding in findings(tmp_path / "new") if finding.is_error]
    tree = metric_tree.open(tmp_path / "new")
    assert tree.version == "0.0.1+cutouts"
    found = tree.find("entity").images().to_pylist()
    assert [row["method"] for row in found].count("plain") == 3  # the refused one was inspected by it too
    assert sum(row["cutout_path"] is not None for row in found) == 2


def test_a_cutout_is_the_box_of_the_picture_and_its_alpha_the_mask(tmp_path):
    old = release_with(tmp_path / "old", [shop_picture(0)])
    cut_release(old, tmp_path / "new", PLAIN, version="1.0.0", created="2026-11-21")
    (row,) = rows(tmp_path / "new").values()
    with Image.open(tmp_path / "new" / row["cutout_path"]) as image:
        assert image.mode == "RGBA"
        assert image.size == tuple(row["box_px"][2:])
        alpha = np.asarray(image.getchannel("A"))
    assert np.allclose(row["box_px"], (60, 50, 120, 100), atol=2)
    assert row["foreground_share"] == pytest.approx(120 * 100 / (240 * 200), rel=0.04)
    assert (alpha >= 128).sum() == round(row["foreground_share"] * 240 * 200)
    assert row["cutout_sha256"] == sha256(tmp_path / "new" / row["cutout_path"])


def test_hostile_files_cost_one_picture_each(tmp_path):
    bodies = [shop_picture(0), *(body for body, _ in HOSTILE.values()), shop_picture(1)]
    old = release_with(tmp_path / "old", bodies)
    made = cut_release(old, tmp_path / "new", PLAIN, version="1.0.0", created="2026-11-21")
    assert made.manifest["cutouts"]["cut"] == {"plain": 2}
    assert made.manifest["cutouts"]["set_aside"] == {"unreadable": len(HOSTILE)}


@pytest.mark.parametrize("name", HOSTILE)
def test_each_hostile_file_is_reported(name):
    body, refusal = HOSTILE[name]
    result = cut("x", body, PLAIN)
    assert (result.set_aside, result.detail, result.png) == ("unreadable", refusal, b"")


@pytest.mark.parametrize("name", [name for name, (_, said) in MAKERS.items() if said is None])
def test_a_picture_that_only_looks_wrong_is_cut(name):
    result = cut("x", MAKERS[name][0](), PLAIN)
    assert (result.method, result.set_aside) == ("plain", None)


def test_a_picture_with_its_own_transparency_needs_no_backend():
    rgba = np.zeros((100, 120, 4), np.uint8)
    rgba[30:70, 40:90] = (200, 30, 30, 255)
    result = cut("x", encoded(Image.fromarray(rgba)), PLAIN)
    assert (result.method, result.box_px, result.set_aside) == ("alpha", (40, 30, 50, 40), None)


def test_a_picture_lying_on_its_side_is_cut_upright():
    image = Image.open(BytesIO(shop_picture(0)))
    exif = image.getexif()
    exif[0x0112] = 6  # a quarter turn
    sink = BytesIO()
    image.save(sink, "JPEG", exif=exif)
    result = cut("x", sink.getvalue(), PLAIN)
    assert (result.cut_width_px, result.cut_height_px) == (200, 240)
    assert result.box_px[2] < result.box_px[3]


def test_an_interrupted_run_takes_up_what_it_had(tmp_path, monkeypatch):
    old = release_with(tmp_path / "old", [shop_picture(seed) for seed in range(20)])

    def killed(done, total):
        if done >= module.IMAGES_PER_CALL:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut_release(old, tmp_path / "new", PLAIN, version="1.0.0", created="2026-11-21", progress=killed)
    assert not (tmp_path / "new").exists()
    cuts = []
    real = module.cut
    monkeypatch.setattr(module, "cut", lambda *words: cuts.append(words[0]) or real(*words))
    cut_release(old, tmp_path / "new", PLAIN, version="1.0.0", created="2026-11-21")
    assert len(cuts) == 20 - module.IMAGES_PER_CALL
    assert len(rows(tmp_path / "new")) == 20
    assert sorted(path.name for path in tmp_path.iterdir() if path.name.startswith("new")) == ["new"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--backend", "rembg"), "--model u2net: expected rembg and its weights on this machine; found none"),
        (("--model", "bria-rmbg"), "--model: expected one of u2net"),
        (("--model", "gone.onnx"), "--model: expected an ONNX file; found none at gone.onnx"),
    ],
)
def test_an_error_of_the_input_is_one_line(words, message, tmp_path, no_weights, capsys):
    old = release_with(tmp_path / "old", [shop_picture(0)])
    assert run(old.directory, "--out", tmp_path / "new", *words) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_a_release_without_pictures_and_a_taken_path_are_told(tmp_path, no_weights, capsys):
    old = release_with(tmp_path / "old", [])
    assert run(old.directory, "--out", tmp_path / "new", "--backend", "plain") == 2
    assert "expected images with files; found none" in capsys.readouterr().err
    assert run(old.directory, "--out", old.directory) == 2
    assert "expected a folder that is not there yet" in capsys.readouterr().err


@pytest.mark.slow
def test_two_dask_worker_processes_over_tcp_cut_the_same(tmp_path, no_weights, capsys):
    distributed = pytest.importorskip("distributed")
    bodies = [shop_picture(seed) for seed in range(20)] + [body for body, _ in HOSTILE.values()]
    old = release_with(tmp_path / "old", bodies)
    assert run(old.directory, "--out", tmp_path / "here", "--backend", "plain") == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, protocol="tcp", dashboard_address=None
    ) as cluster:
        assert cluster.scheduler_address.startswith("tcp://")
        words = ("--backend", "plain", "--scheduler", cluster.scheduler_address)
        assert run(old.directory, "--out", tmp_path / "there", *words) == 0
        with distributed.Client(cluster) as client:
            done = client.run(lambda dask_worker: (os.getpid(), dask_worker.state.transition_counter))
    processes = {process for process, _ in done.values()}
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert all(counter > 0 for _, counter in done.values())  # each had work
    files = sorted(path.relative_to(tmp_path / "here") for path in (tmp_path / "here").rglob("*") if path.is_file())
    assert sum(path.suffix == ".png" for path in files) == 20
    for path in files:
        assert (tmp_path / "here" / path).read_bytes() == (tmp_path / "there" / path).read_bytes()


@pytest.mark.parametrize(("n_clear", "method"), [(99, "plain"), (100, "alpha")])
def test_a_transparency_of_one_percent_of_the_pixels_is_a_mask(n_clear: int, method: str) -> None:
    rgba = np.array(Image.open(BytesIO(shop_picture(0))).convert("RGBA").resize((100, 100)))
    rgba[..., 3].flat[:n_clear] = 0
    assert cut("x", encoded(Image.fromarray(rgba)), PLAIN).method == method


@pytest.mark.parametrize(("side", "width"), [(1500, 1500), (1600, 1600), (1700, 1600)])
def test_an_image_is_cut_with_at_most_1600_pixels(side: int, width: int) -> None:
    pixels, alpha = module.upright_pixels(Image.new("RGB", (side, 8)))
    assert (pixels.shape[1], alpha) == (width, None)


def test_a_picture_that_cannot_be_turned_is_unreadable(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(_: object) -> None:
        raise SyntaxError("x" * 100)

    monkeypatch.setattr(module, "upright_pixels", failing)
    result = cut("x", shop_picture(0), PLAIN)
    assert (result.set_aside, result.detail) == ("unreadable", "x" * 80)


def test_an_edge_without_contrast_is_accepted_if_a_reviewer_drew_it() -> None:
    body = encoded(Image.new("RGB", (200, 200), (120, 120, 120)))
    image_id = "0" * 64
    drawn = Guide(picture=image_id, box=(50.0, 50.0, 100.0, 100.0), reviewer="a")
    outcomes = [cut(image_id, body, Settings("plain", drawn=guides)).set_aside for guides in ((), (drawn,))]
    assert outcomes[0] == "empty"
    assert outcomes[1] in (None, "empty", "full")
