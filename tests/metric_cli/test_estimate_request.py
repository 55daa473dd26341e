"""Conditions of the options of `estimate-scale`: each line of the table is refused with a message, or is a request."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from estimator.evidence.depth_maps import MetricDepth
from metric_base.errors import InputError
from metric_cli.batch import batch_scenes, option_words, options_of
from metric_cli.estimate_scale.estimate import BATCH
from metric_cli.estimate_scale.parser import parser
from metric_cli.estimate_scale.request import EstimateRequest, parse_request, without_options
from metric_cli.insert_object.insert import BATCH as INSERTIONS


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a model, a photograph, a video, a trajectory, and files for options; also the current one."""
    for name in ("photo.jpg", "video.mp4", "walk.txt", "depth.npy", "masks.json", "track.csv", "o.json"):
        (tmp_path / name).touch()
    for name in ("model", "images", "depths"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def request(line: str) -> EstimateRequest:
    return parse_request(shlex.split(line))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("model", None),
        ("--objects o.json", None),
        ("model --objects o.json", "expected a SCENE or --objects FILE; found both"),
        ("", "expected a SCENE or --objects FILE; found neither"),
        ("photo.jpg --depth-map depth.npy", None),
        ("photo.jpg --points depth.npy", None),
        ("photo.jpg --depth-map depth.npy --points depth.npy", "--points: expected no --depth-map"),
        ("model --depth-map depth.npy", "--depth-map: expected a photograph as SCENE; found model"),
        ("model --points depth.npy", "--points: expected a photograph as SCENE; found model"),
        ("--objects o.json --points depth.npy", "--points: expected a photograph as SCENE; found --objects"),
        ("model --images images", None),
        ("model --images photo.jpg", "--images: expected a folder of images; found photo.jpg"),
        ("model --detector a.onnx --detector-labels walk.txt", None),
        ("model --detector-labels walk.txt", "--detector-labels: expected --detector; found none"),
        ("model --detector a.onnx --instances masks.json", "--detector: expected no --instances"),
        ("model --detector a.onnx --categories masks.json", "--detector: expected no --categories"),
        ("model --detector a.onnx --draw", "--detector: expected no --draw"),
        ("model --instances masks.json --categories masks.json", None),
        ("model --method paper", None),
        ("model --method sucar", None),
        ("--objects o.json --method sucar", "--method sucar: expected a SCENE"),
        ("--objects o.json --method paper", None),
        ("model --method paper --paper-lists images", None),
        ("model --method height --paper-lists images", "--paper-lists: expected --method paper; found --method height"),
        ("model --method height --where europe", None),
        ("model --method sucar --where europe", "--where: expected --method default or height; found --method sucar"),
        ("model --method paper --known-length 0,0,0 0,0,1 1", "--known-length: expected --method default or height"),
        ("model --known-length 0,0,0 0,0,1 1", None),
        ("model --known-length 0,0,0 0,0,1 1 cm", None),
        ("model --known-length 0,0,0 0,0,1 1 chairs", "found 4: 0,0,0 0,0,1 1 chairs"),
        ("model --known-length 'chair 1' height 0.8", None),
        ("--objects o.json --known-length 'chair 1' height 0.8", "--known-length: names of objects: expected a SCENE"),
        ("model --up 0,0,1", None),
        ("--objects o.json --up 0,0,1", "--up: expected a SCENE; found --objects"),
        ("model --level 0.01", None),
        ("model --level 0.99", None),
        ("model --level 0", "--level: expected a number between 0 and 1"),
        ("model --level 1", "--level: expected a number between 0 and 1"),
        ("video.mp4 --frames 9", None),
        ("model --frames 9", "--frames: expected a video or a folder of images as SCENE, found model"),
        ("model --max-time 9", "--max-time: expected a video or a folder of images as SCENE"),
        ("model --camera-model PINHOLE", "--camera-model: expected a video or a folder of images as SCENE"),
        ("model --focal 500", "--focal: expected a video or a folder of images as SCENE"),
        ("walk.txt --focal 500", None),
        ("photo.jpg --depth-map depth.npy --focal 500", None),
        ("photo.jpg --points depth.npy --focal 500", None),
        ("photo.jpg --focal 500", "--focal: expected a video or a folder of images as SCENE"),
        ("model --draw --work images", None),
        ("model --work images", "--work: expected a video or a folder of images as SCENE"),
        ("--objects o.json --draw", "--draw: expected a video or a folder of images as SCENE, found o.json"),
        ("video.mp4 --instances masks.json", None),
        ("video.mp4 --instances absent.json", "absent.json: file: expected a readable file, found no such file"),
        ("model --gps exif", None),
        ("model --gps track.csv", None),
        ("model --gps absent.csv", "--gps: expected auto, exif, none, or a file; found no file absent.csv"),
        ("model --imu track.csv", None),
        ("model --imu absent.csv", "--imu: expected auto, none, or a file; found no file absent.csv"),
        ("--objects o.json --gps auto --imu none", None),
        ("--objects o.json --gps exif", "evidence: expected a SCENE and --method default or height, found --objects"),
        ("--objects o.json --imu track.csv", "evidence: expected a SCENE"),
        ("--objects o.json --camera-height 1.5", "evidence: expected a SCENE"),
        ("model --method sucar --camera-height 1.5", "found --method sucar"),
        ("model --method height --camera-height 1.5", None),
        ("model --metric-depth depths", None),
        ("model --metric-depth absent", "--metric-depth: expected a folder of depth maps, or scene"),
        ("model --metric-depth depths --depth-error 1", None),
        ("model --metric-depth depths --depth-error 0", "--depth-error: value: expected a fraction above 0"),
        ("model --metric-depth depths --depth-error wide", "--depth-error: value: expected a fraction above 0"),
        ("model --overlay out", None),
        ("--objects o.json --overlay out", "--overlay: expected a SCENE; found --objects"),
        ("--objects o.json --write-scaled out", "--write-scaled: expected a SCENE; found --objects"),
        ("--objects o.json --view-glb a.glb", "--view-glb: expected a SCENE; found --objects"),
        ("model --view-png a.png --view-glb a.glb", None),
        ("model --view-png a.jpg", "--view-png: expected a name that ends with .png; found a.jpg"),
        ("model --view-glb a.png", "--view-glb: expected a name that ends with .glb; found a.png"),
        ("model --figure a.pdf --output a.json", None),
        ("model --figure a.out --output a.out", "--figure: expected another file than --output; found a.out"),
        ("model --output absent/a.json", "--output: expected a file in a folder that exists; found absent/a.json"),
        ("model --output images", "--output"),
        ("model --jobs 2", "--jobs: expected --batch LIST and --out RESULTS.parquet; found none"),
        ("model --part 1/2", "--part: expected --batch LIST and --out RESULTS.parquet; found none"),
        ("model --out a.parquet", "--out: expected --batch LIST and --out RESULTS.parquet; found none"),
    ],
)
def test_options_that_go_together(line: str, message: str | None, here: Path) -> None:
    if message is None:
        assert request(line).command == f"estimate-scale {line}".rstrip()
    else:
        with pytest.raises(InputError) as error:
            request(line)
        assert message in str(error.value)
        assert sorted(path.name for path in here.glob("*.out")) == []


@pytest.mark.parametrize(
    ("options", "form"),
    [
        ("", "table"),
        ("--wide", "wide"),
        ("--quiet --wide", "quiet"),
        ("--csv --quiet", "csv"),
        ("--csv --json", "json"),
    ],
)
def test_json_comes_before_csv_quiet_and_wide(options: str, form: str, here: Path) -> None:
    assert request(f"model {options}").form == form


def test_the_work_folder_is_next_to_the_scene_or_the_scene_itself(here: Path) -> None:
    assert request("model").work == Path("model.metric-tree")
    assert request("video.mp4 --work w").work == Path("w")
    assert request("--objects o.json").work is None
    (here / "model" / "frames.json").write_text("{}")
    assert request("model --draw").work == Path("model")


@pytest.mark.parametrize(
    ("line", "dense"),
    [
        ("model", None), ("model --dense auto", None), ("model --dense a.ply", "a.ply"), ("model --dense none", "none"),
        ("video.mp4", "none"), ("video.mp4 --dense auto", "none"),
    ],
)  # fmt: skip
def test_dense_points_of_a_capture_are_no_measurements(line: str, dense: str | None, here: Path) -> None:
    found = request(line)
    assert found.dense == dense
    assert (found.capture is not None) == line.startswith("video")
    (here / "model" / "frames.json").write_text("{}")
    assert request("model").dense == "none"


def test_a_detector_runs_on_the_frames_of_a_capture(here: Path) -> None:
    assert request("video.mp4 --images images --detector a.onnx").images is None
    assert request("video.mp4 --images images").images == Path("images")
    assert request("model --images images --detector a.onnx").images == Path("images")


def test_a_track_of_positions_belongs_to_the_recording(here: Path) -> None:
    (here / "track.srt").touch()
    assert request("model --gps track.srt").sources == ()
    assert len(request("model --gps track.csv").sources) == 1
    assert len(request("model --gps exif").sources) == 1
    names = [request(f"model {words}").names_evidence for words in ("", "--gps none", "--gps track.srt", "--gps exif")]
    assert names == [False, False, True, True]
    assert request("model --known-length 0,0,0 0,0,1 1").names_evidence
    assert request("model --imu track.csv").names_evidence


@pytest.mark.parametrize(
    ("unit", "metres", "of_focal"),
    [("metres", 0.001, "metres"), ("1/256", 1 / 256, "metres"), ("da3", 1.0, "da3"), ("metric3d", 1.0, "metric3d")],
)
def test_units_of_depth_maps(unit: str, metres: float, of_focal: str, here: Path) -> None:
    found = request(f"model --metric-depth depths --depth-unit {unit}")
    (source,) = found.sources
    assert isinstance(source, MetricDepth)
    assert (source.png_metres, source.unit, found.png_unit) == (metres, of_focal, metres)


@pytest.mark.parametrize(
    ("line", "names", "rest"),
    [
        ("s --known-length 0,0,0 1,0,0 2 cm --json", ["--known-length"], "s --json"),
        ("s --known-length a b 2 --json", ["--known-length"], "s --json"),
        ("s --draw 80 --json", ["--draw"], "s --json"),
        ("s --draw --json", ["--draw"], "s --json"),
        ("s --json x", ["--json"], "s x"),
        ("s --frames=9 x", ["--frames"], "s x"),
        ("s --frames 9 --focal 5", ["--frames", "--focal"], "s"),
        ("s", ["--frames"], "s"),
    ],
)
def test_the_suggested_command_lacks_an_option_and_its_values(line: str, names: list[str], rest: str) -> None:
    assert without_options(line.split(), names) == f"estimate-scale {rest}"


def test_words_before_the_first_option_of_a_batch_are_refused(here: Path) -> None:
    assert options_of(["--level", "0.8", "--instances=m.json", "--up", "photo.jpg"]) == {
        "--level": ["--level", "0.8"],
        "--instances": ["--instances=m.json"],
        "--up": ["--up", str(here / "photo.jpg")],  # a path of the current folder becomes absolute
    }
    with pytest.raises(InputError, match="expected options and --batch LIST; found scene"):
        options_of(["scene", "--level", "0.8"])


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("strict", True, ["--strict"]),
        ("strict", "0", []),
        ("frames", 20.0, ["--frames=20"]),
        ("level", 0.5, ["--level=0.5"]),
        ("marker", ["a:1", "b:2"], ["--marker=a:1", "--marker=b:2"]),
        ("known_length", "a b 'c d'", ["--known-length", "a", "b", "c d"]),
        ("known_length", ["f.csv", 1], ["--known-length", "f.csv", "1"]),
        (
            "known_length",
            [["a", "b", 1], ["c", "d", 2]],
            ["--known-length", "a", "b", "1", "--known-length", "c", "d", "2"],
        ),
    ],
)
def test_a_column_of_a_list_is_an_option(column: str, value: object, words: list[str]) -> None:
    assert option_words(parser(), "list: row 1", column, value) == words


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("strict", "yes", "expected true or false"),
        ("levle", 1, "an option of estimate-scale, found none; did you mean"),
    ],
)
def test_a_column_that_is_no_option_or_no_truth_value(column: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        option_words(parser(), "list: row 1", column, value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scene,level\n", "at least one scene"),
        ("scene,level\n,0.5\n", "expected a path, found none"),
        ("scene,options\na,--draw\n", "that are not interactive, found --draw"),
        ("scene,options\na,--lvl 1\n", "that are not interactive, found --lvl"),
        ("scene,output\na,o.json\nb,o.json\n", "other outputs than those of"),
    ],
)
def test_a_list_that_cannot_be_run(text: str, message: str, here: Path) -> None:
    (here / "list.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        batch_scenes(BATCH, Path("list.csv"), [])


def test_scenes_of_a_list(here: Path) -> None:
    (here / "list.csv").write_text("scene,objects,level,output,work\n-a,,0.5,o.json,w\n,o.json,,,\nb,,nan,,x\n")
    first, second, third = batch_scenes(BATCH, Path("list.csv"), ["--level", "0.8", "--method", "height"])
    words = ["./-a", "--level=0.5", "--method", "height", "--output=o.json", "--work=w"]
    assert list(first.words) == words
    assert list(second.words) == ["--level", "0.8", "--method", "height", "--objects=o.json"]
    assert list(third.words) == ["b", "--level", "0.8", "--method", "height", "--work=x"]
    assert [scene.name for scene in (first, second, third)] == ["-a", "o.json", "b"]


def test_a_required_option_is_before_those_that_modify_it(here: Path) -> None:
    (here / "list.csv").write_text("scene,size,model\na,height=1,m.glb\n")
    (scene,) = batch_scenes(INSERTIONS, Path("list.csv"), ["--out", "a.mp4"])
    assert list(scene.words) == ["a", "--model=m.glb", "--out", "a.mp4", "--size=height=1"]
