"""Real ONNX graphs through the real onnxruntime: masks, labels, errors, and the whole command."""

from __future__ import annotations

import hashlib
import json
import math
import re
import threading
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from estimator.detectors import detector
from estimator.detectors.detect import detect_instances
from estimator.detectors.detector import Detector, load_detector
from estimator.detectors.registry import RegisteredDetector, download, registry, registry_entry
from estimator.instances.instance_reader import read_instances
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from metric_cli.estimate_scale.estimate import main
from metric_tree.tree import Tree
from taxonomy.label_lists import label_names
from tests.synthetic.detectors import COLOURS, box_mask_graph, constant_graph, paint_graph, save
from tests.synthetic.small_scene import write_small_scene

LABELS = ("", "swivel chair", "bar stool")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small scene with its instances as paint in lossless images, and instances.json renamed."""
    root = tmp_path_factory.mktemp("scene")
    write_small_scene(root)
    scene = read_scene(root / "colmap")
    (root / "images").mkdir()
    for row, view in enumerate(scene.views):
        canvas = np.full((view.camera.height, view.camera.width, 3), 90, dtype=np.uint8)
        for instance in read_instances(None, scene):
            if instance.view == row:
                colour = COLOURS[("chair", "table").index(instance.category)]
                (x, y), (h, w) = instance.origin, instance.mask.shape
                canvas[y : y + h, x : x + w][instance.mask] = colour[::-1]
        name = root / "images" / Path(view.name).with_suffix(".png").name
        cv2.imwrite(str(name), canvas)
        name.rename(root / "images" / Path(view.name).name)
    return root


def test_masks_are_those_of_the_graph(folder: Path, tmp_path: Path) -> None:
    scene = read_scene(folder / "colmap")
    detector = Detector(paint_graph(tmp_path / "paint.onnx"), ("", "chair", "table"))
    found, warnings = detect_instances(scene, folder / "images", detector)
    expected = read_instances(None, scene)
    assert warnings == ()
    assert len(found) == len(expected) > 0
    by_key = {(instance.view, instance.category): instance for instance in expected}
    for instance in found:
        twin = by_key[instance.view, instance.category]
        assert instance.origin == twin.origin
        assert np.array_equal(instance.mask, twin.mask)
        assert instance.score == pytest.approx(0.9, abs=1e-4)
        assert not instance.from_box


def test_a_graph_traced_for_one_size_is_fed_that_size(folder: Path, tmp_path: Path) -> None:
    scene = read_scene(folder / "colmap")
    detector = Detector(paint_graph(tmp_path / "paint.onnx", fixed=(120, 160)), ("", "chair", "table"))
    found, _ = detect_instances(scene, folder / "images", detector)
    for instance, twin in zip(found, sorted(read_instances(None, scene), key=lambda one: one.view), strict=True):
        assert abs(int(instance.mask.sum()) / int(twin.mask.sum()) - 1) < 0.1


@pytest.mark.parametrize("size", [(400, 600), (1600, 900), (300, 2400)])
def test_small_masks_are_stretched_over_their_boxes(tmp_path: Path, size: tuple[int, int]) -> None:
    height, width = size
    factor = min(800 / min(size), 1333 / max(size))
    mask = np.zeros((28, 28))
    mask[:, :14] = 1  # the left half of the box
    box = np.array([100, 60, 300, 260.0])
    graph = box_mask_graph(tmp_path / "zoo.onnx", tuple(box * factor), mask)
    (seen,) = Detector(graph, ("", "person"), "caffe")(np.zeros((height, width, 3), dtype=np.uint8)).masks
    assert seen.shape == size
    rows, columns = np.nonzero(seen)
    assert (columns.min(), rows.min(), rows.max() + 1) == pytest.approx((100, 60, 260), abs=1)
    assert columns.max() + 1 == pytest.approx(200, abs=2)


@pytest.mark.parametrize(("channel", "mean"), [(0, 102.9801), (1, 115.9465), (2, 122.7717)])
def test_the_zoos_input_is_blue_green_red_less_the_means(tmp_path: Path, channel: int, mean: float) -> None:
    graph = box_mask_graph(tmp_path / "zoo.onnx", (0, 0, 100, 100), np.ones((28, 28)), channel)
    picture = np.zeros((40, 60, 3), dtype=np.uint8)  # RGB
    picture[..., 2 - channel] = 250
    detector = Detector(graph, ("", "person"), "caffe")
    assert detector(picture).scores == pytest.approx([(250 - mean) / 200], abs=1e-4)
    assert len(detector(250 - picture).scores) == 0  # the other two channels: nothing here


def test_a_file_of_the_registry_is_known_by_its_sha256(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    graph = box_mask_graph(tmp_path / "any name.onnx", (0, 0, 100, 100), np.ones((28, 28)))
    own = RegisteredDetector(
        "zoo", "", ("https://example.org/a",), hashlib.sha256(graph.read_bytes()).hexdigest(), "MIT", "caffe", "coco_80"
    )
    assert (load_detector(graph).form, load_detector(graph).labels[12]) == ("torchvision", "")
    monkeypatch.setattr("estimator.detectors.registry.registry", lambda: (own,))
    assert (load_detector(graph).form, load_detector(graph).labels[12]) == ("caffe", "stop sign")


def test_a_box_beyond_the_picture_is_cut(tmp_path: Path) -> None:
    graph = box_mask_graph(tmp_path / "zoo.onnx", (-50, -50, 100, 2000), np.ones((28, 28)))
    (seen,) = Detector(graph, ("", "person"))(np.zeros((200, 300, 3), dtype=np.uint8)).masks
    assert seen[:, :98].all()
    assert not seen[:, 101:].any()


def test_the_whole_command_needs_no_masks_file(
    folder: Path, tmp_path: Path, mini: Tree, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare"
    bare.mkdir()
    for name in ("cameras.bin", "images.bin", "points3D.bin", "frames.bin", "rigs.bin"):
        (bare / name).write_bytes((folder / "colmap" / name).read_bytes())
    (tmp_path / "labels.txt").write_text("swivel chair\nbar stool\n")
    graph = paint_graph(tmp_path / "paint.onnx")
    words = [str(bare), "--tree", str(mini.release.directory), "--json"]
    own = [
        "--images",
        str(folder / "images"),
        "--detector",
        str(graph),
        "--detector-labels",
        str(tmp_path / "labels.txt"),
    ]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "--detector" in error
    assert "--images DIR" in error
    assert "docs/how-to/first-scale.md" in error
    status = main(words + own)
    record = json.loads(capsys.readouterr().out)
    # the same masks from a file give the same answer
    document = json.loads((folder / "colmap" / "instances.json").read_text())
    document["categories"] = [{"id": k, "name": name} for k, name in enumerate(LABELS[1:], start=1)]
    for row in document["annotations"]:
        row.pop("track_id", None)  # a detector follows nothing from image to image
    (tmp_path / "masks.json").write_text(json.dumps(document))
    assert main([*words, "--instances", str(tmp_path / "masks.json")]) == status
    other = json.loads(capsys.readouterr().out)
    assert {item["category"] for item in record["objects"]} == {"swivel chair", "bar stool"}
    assert record["scale"] == other["scale"]
    sizes = [
        sorted((item["category"], *item["dimensions"].values()) for item in one["objects"]) for one in (record, other)
    ]
    assert sizes[0] == sizes[1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--detector", "x.onnx"], "x.onnx: --detector: expected an ONNX file, auto, or a name of the registry"),
        (["--detector-labels", "x"], "--detector"),
        (["--images", ".", "--detector", "no-such"], "maskrcnn-12"),
        (["--images", ".", "--detector", "x", "--instances", "y"], "--instances"),
        (["--images", ".", "--detector", "x", "--categories", "y"], "--categories"),
    ],
)
def test_errors_of_the_arguments_are_one_line(
    folder: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(folder / "colmap"), *words]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_errors_of_graphs_and_pictures_name_the_file(folder: Path, tmp_path: Path) -> None:
    scene = read_scene(folder / "colmap")
    junk = tmp_path / "junk.onnx"
    junk.write_bytes(b"no graph")
    with pytest.raises(InputError, match=r"junk\.onnx.*ONNX graph"):
        Detector(junk, LABELS)
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [3, "h", "w"])
    same = helper.make_tensor_value_info("same", TensorProto.FLOAT, [3, "h", "w"])
    copy = save(tmp_path / "copy.onnx", [helper.make_node("Identity", ["picture"], ["same"])], {}, picture, [same])
    with pytest.raises(InputError, match=r"copy\.onnx.*outputs: expected the outputs of Mask R-CNN"):
        Detector(copy, LABELS)
    detector = Detector(paint_graph(tmp_path / "paint.onnx"), LABELS)
    with pytest.raises(InputError, match="no such folder"):
        detect_instances(scene, tmp_path / "nowhere", detector)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="none of them"):
        detect_instances(scene, tmp_path / "empty", detector)
    (tmp_path / "empty" / Path(scene.views[0].name).name).write_bytes(b"no picture")
    with pytest.raises(InputError, match="OpenCV"):
        detect_instances(scene, tmp_path / "empty", detector)
    with pytest.raises(InputError, match="label"):
        detect_instances(scene, folder / "images", Detector(tmp_path / "paint.onnx", ("", "chair")))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ({"count": 1_000_000}, "detections: expected at most 1,000 of score 0.5 or more in an image, found 1,000,000"),
        ({"count": 3, "score": math.nan}, "scores: expected numbers from 0 to 1, found nan"),
        ({"count": 3, "score": math.inf}, "scores: expected numbers from 0 to 1, found inf"),
        ({"count": 3, "mask": (0, 0)}, "masks: expected sides of 1 to 10,000 pixels"),
        ({"count": 1, "mask": (60_000, 60_000)}, "run: expected outputs"),
        ({"count": 1 << 40}, "run: expected outputs"),
    ],
)
def test_what_no_detector_answers_is_one_line(tmp_path: Path, answer: dict[str, Any], words: str) -> None:
    detector = load_detector(constant_graph(tmp_path / "hostile.onnx", **answer))
    with pytest.raises(InputError, match=re.escape(words)):
        detector(np.zeros((48, 64, 3), dtype=np.uint8))


@pytest.mark.parametrize("box", [math.nan, 1e30, -1e30])
def test_a_box_of_no_numbers_holds_nothing(tmp_path: Path, box: float) -> None:
    seen = load_detector(constant_graph(tmp_path / "hostile.onnx", 2, box=box))(np.zeros((48, 64, 3), dtype=np.uint8))
    assert [int(mask.sum()) for mask in seen.masks] == [0, 0]


@pytest.mark.parametrize(
    ("text", "words"),
    [(b"a\n" * 100_001, "labels: expected at most 100,000 lines"), (b"t\xe4ble", "encoding"), (b"", "some content")],
)
def test_a_file_of_labels_is_bounded(tmp_path: Path, text: bytes, words: str) -> None:
    (tmp_path / "labels.txt").write_bytes(text)
    with pytest.raises(InputError, match=words):
        load_detector(constant_graph(tmp_path / "few.onnx", 1), tmp_path / "labels.txt")


def test_coco_ids_have_their_gaps() -> None:
    names = label_names("coco_91")
    assert (names[1], names[13], names[44], names[62], names[90]) == (
        "person", "stop sign", "bottle", "chair", "toothbrush",
    )  # fmt: skip
    assert names[12] == names[83] == ""
    assert (label_names("coco_80")[1], label_names("coco_80")[80]) == ("person", "toothbrush")


def test_the_registry_is_whole() -> None:
    entries = registry()
    names = ["rfdetr-seg-medium", "rfdetr-seg-nano", "maskrcnn-12", "maskrcnn-12-int8"]
    assert [entry.name for entry in entries] == names
    assert registry_entry("auto") == entries[0]
    assert entries[2].description == "maskrcnn-12, 178 MB, MIT"
    for entry in entries:
        assert entry.input in {"rfdetr", "caffe"}
        assert isinstance(entry.labels, str)
        assert label_names(entry.labels)[1] == "person"
        assert len(entry.sha256) == 64
        assert all(url.startswith("https://") for url in entry.urls)


@pytest.mark.parametrize("line", ['sha256 = ""', 'urls = []\nsha256 = "%s"' % ("0" * 64), 'sha256 = "bf2d0c1e"'])
def test_an_entry_that_nobody_can_check_is_refused(tmp_path: Path, line: str) -> None:
    file = tmp_path / "detectors.toml"
    urls = "" if "urls" in line else 'urls = ["https://example.org/a.onnx"]\n'
    file.write_text(f'[made]\ntitle = ""\nlicence = "MIT"\ninput = "caffe"\nlabels = "coco_80"\n{urls}{line}\n')
    with pytest.raises(InputError, match=r"detectors\.toml: made: expected an address and a sha256"):
        registry(file)


def test_a_registration_file_of_the_user_names_its_network(tmp_path: Path) -> None:
    graph = paint_graph(tmp_path / "own.onnx")
    sha256 = hashlib.sha256(graph.read_bytes()).hexdigest()
    file = tmp_path / "detector.toml"
    file.write_text(f'[detector]\nfile = "own.onnx"\nsha256 = "{sha256}"\nlabels = ["swivel chair", "bar stool"]\n')
    assert load_detector(file).labels == ("", "swivel chair", "bar stool")
    file.write_text(file.read_text().replace(sha256, "0" * 64))
    with pytest.raises(InputError, match=r"own\.onnx: sha256: expected 0000"):
        load_detector(file)
    file.write_text("[detector")
    with pytest.raises(InputError, match=r"detector\.toml: expected TOML, found: "):
        load_detector(file)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    folder = tmp_path / "served"
    folder.mkdir()
    paint_graph(folder / "model.onnx")
    handler = partial(SimpleHTTPRequestHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as serving:
        threading.Thread(target=serving.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{serving.server_port}/model.onnx"
        serving.shutdown()


def test_a_download_is_checked_and_kept(server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "cache"))
    right = hashlib.sha256((tmp_path / "served" / "model.onnx").read_bytes()).hexdigest()
    entry = RegisteredDetector("made", "", (server,), right, "CC0-1.0", "torchvision", "coco_80")
    with pytest.raises(InputError, match="sha256"):
        download(replace(entry, sha256="0" * 64))
    notices: list[str] = []
    kept = download(entry, notices.append)
    size = f"{(tmp_path / 'served' / 'model.onnx').stat().st_size / 1e6:.0f} MB"
    assert notices == [f"downloading made, {size}, CC0-1.0, from {server} to {tmp_path / 'cache'}"]
    assert download(entry, notices.append) == kept
    assert len(notices) == 1
    assert kept.is_relative_to(tmp_path / "cache")
    assert load_detector(kept).labels[62] == "chair"
    gone = "http://127.0.0.1:9/x"
    with pytest.raises(InputError, match="download"):
        download(replace(entry, name="gone", urls=(gone,)))
    assert download(replace(entry, name="moved", urls=(gone, server))).is_file()  # the second address has it


@pytest.mark.parametrize(("value", "is_inside"), [(0.49, False), (0.51, True)])
def test_a_pixel_of_a_mask_has_a_value_of_one_half(tmp_path: Path, value: float, is_inside: bool) -> None:
    box = np.array([100, 60, 300, 260.0]) * 800 / 400
    graph = box_mask_graph(tmp_path / "zoo.onnx", tuple(box), np.full((28, 28), value))
    (seen,) = Detector(graph, ("", "person"), "caffe")(np.zeros((400, 600, 3), dtype=np.uint8)).masks
    assert bool(seen[160, 200]) == is_inside


def _first_of(shape: list[int | str], path: Path, n_inputs: int = 1) -> Path:
    """A graph of torchvision's signature whose first input has a shape; others have one number."""
    constants = {
        "boxes": np.ones((1, 4), dtype=np.float32), "labels": np.ones(1, dtype=np.int64),
        "scores": np.ones(1, dtype=np.float32), "masks": np.ones((1, 1, 4, 4), dtype=np.float32),
    }  # fmt: skip
    outputs = [
        helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(value.dtype), list(value.shape))
        for name, value in constants.items()
    ]
    nodes = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))
        for name, value in constants.items()
    ]
    sizes = [shape, *[[1]] * (n_inputs - 1)]
    inputs = [helper.make_tensor_value_info(f"i{k}", TensorProto.FLOAT, size) for k, size in enumerate(sizes)]
    graph = helper.make_graph(nodes, "detector", inputs, outputs)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize(
    ("shape", "n_inputs", "message"),
    [
        ([3, 10_000, "w"], 1, None),
        ([3, 10_001, "w"], 1, "input: expected sides of 1 to 10,000 pixels"),
        ([3, 0, "w"], 1, "input: expected sides of 1 to 10,000 pixels"),
        ([1, 3, "h", "w"], 1, None),
        (["h", "w"], 1, "input: expected one image"),
        ([1, 1, 3, "h", "w"], 1, "input: expected one image"),
        ([3, "h", "w"], 2, "input: expected one image"),
    ],
)
def test_the_input_of_a_graph_is_one_image(
    shape: list[int | str], n_inputs: int, message: str | None, tmp_path: Path
) -> None:
    path = _first_of(shape, tmp_path / "a.onnx", n_inputs)
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        Detector(path, LABELS)


@pytest.mark.parametrize("name", ["boxes", "labels", "scores", "masks"])
def test_outputs_of_different_lengths_are_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {
        "boxes": np.ones((2, 4)), "labels": np.ones(2, dtype=int), "scores": np.ones(2), "masks": np.ones((2, 1, 4, 4)),
    }  # fmt: skip
    seen = load_detector(constant_graph(tmp_path / "a.onnx", 2))
    monkeypatch.setattr(detector, "run_graph", lambda *_: list(found.values()))
    assert len(seen(np.zeros((48, 64, 3), dtype=np.uint8)).masks) == 2
    found[name] = found[name][:, :3] if name == "boxes" else found[name][:1]
    with pytest.raises(InputError, match=r"outputs: expected boxes \(n, 4\)"):
        seen(np.zeros((48, 64, 3), dtype=np.uint8))


@pytest.mark.parametrize(
    ("scores", "message"),
    [
        ([0.5] * 1000 + [0.49] * 50, None),  # MAX_DETECTIONS of MIN_SCORE
        ([0.5] * 1001, "at most 1,000 of score 0.5 or more in an image, found '?1,001"),
        ([-0.9e-3, 1 + 0.9e-3], None),  # SCORE_TOLERANCE
        ([-1.1e-3], "numbers from 0 to 1"),
        ([1 + 1.1e-3], "numbers from 0 to 1"),
        ([math.nan], "numbers from 0 to 1"),
    ],
)
def test_scores_of_an_image(scores: list[float], message: str | None) -> None:
    graph: Any = SimpleNamespace(path="a.onnx")
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        Detector.check_scores(graph, np.array(scores))


@pytest.mark.parametrize(("value", "is_inside"), [(0.49, False), (0.51, True)])
@pytest.mark.parametrize("size", [(4, 4), (8, 6)])
def test_a_pixel_of_a_mask_has_a_value_of_a_half(size: tuple[int, int], value: float, is_inside: bool) -> None:
    masks = np.full((1, 1, 4, 4), value)
    assert (detector.full_size_mask(masks, 0, size) == is_inside).all()
    assert (detector.pasted_mask(masks, np.array([[0.0, 0, *size]]), 0, size) == is_inside).all()


@pytest.mark.parametrize(("right", "n_pixels"), [(4.0, 16), (79.0, 32), (81.0, 0), (-79.0, 0)])
def test_a_box_is_within_ten_sides_of_the_image(right: float, n_pixels: int) -> None:
    """MAX_BOX_DISTANCE for an image of 8 x 4 pixels: boxes beyond 80 pixels are nowhere."""
    box = np.array([[0.0 if right > 0 else right - 0.5, 0.0, right, 4]])
    assert int(detector.pasted_mask(np.ones((1, 1, 4, 4)), box, 0, (8, 4)).sum()) == n_pixels


@pytest.mark.parametrize(("n_bytes", "is_read"), [(1 << 31, True), ((1 << 31) + 1, False)])
def test_a_graph_has_at_most_two_gibibytes(
    n_bytes: int, is_read: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MAX_GRAPH_BYTES, of a file without blocks on the disk."""
    with (tmp_path / "a.onnx").open("wb") as file:
        file.truncate(n_bytes)
    read: list[Path] = []
    monkeypatch.setattr(detector, "registry_entry_of", read.append)
    monkeypatch.setattr(detector, "Detector", lambda *_: None)
    with nullcontext() if is_read else pytest.raises(InputError, match="at most 2,147,483,648 bytes"):
        load_detector(tmp_path / "a.onnx")
    assert len(read) == is_read


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"a\n" * 100_000, None),
        (b"a\n" * 100_001, "labels: expected at most 100,000 lines"),
        (b"a" * (1 << 24), None),
        (b"a" * ((1 << 24) + 1), "at most 16,777,216 bytes"),
    ],
)
def test_a_detector_has_at_most_100000_labels_in_16_mebibytes(
    text: bytes, message: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "labels.txt").write_bytes(text)
    monkeypatch.setattr(detector, "Detector", lambda *_: None)
    monkeypatch.setattr(detector, "registry_entry_of", lambda _: None)
    (tmp_path / "a.onnx").touch()
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        load_detector(tmp_path / "a.onnx", tmp_path / "labels.txt")


@pytest.mark.parametrize(
    ("size", "shape", "ratio"),
    [((400, 400), (800, 800), 2.0), ((400, 240), (1344, 800), 3.3325), ((600, 600), (800, 800), 4 / 3)],
)
def test_an_image_for_caffe_has_a_shorter_side_of_800_and_a_longer_one_of_1333(
    size: tuple[int, int], shape: tuple[int, int], ratio: float
) -> None:
    """The sides are padded to multiples of 32; (height, width)."""
    graph: Any = SimpleNamespace(form="caffe", _input=SimpleNamespace(shape=[3, "h", "w"]))
    inputs, factor = Detector.prepare(graph, np.zeros((*size, 3), dtype=np.uint8))
    assert inputs.shape == (3, *shape)
    assert factor == pytest.approx([ratio, ratio], rel=2e-3)
