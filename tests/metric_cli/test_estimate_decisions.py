"""Decisions of `estimate-scale` with replaced stages: masks, outputs, printed result, exit status and next command."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from capture.mapping.refusals import CaptureFailure, Failure
from metric_base.errors import InputError
from metric_cli.estimate_scale import estimate
from metric_cli.estimate_scale.request import Outputs

NOTHING: dict[str, Any] = dict.fromkeys(Outputs.__slots__)


def outputs(**given: Any) -> Outputs:
    return Outputs(**NOTHING | given)


def request(**given: Any) -> Any:
    values = {
        "command": "estimate-scale s", "scene": Path("s"), "objects": None, "capture": None, "work": None,
        "draw_port": None, "instances": None, "categories": None, "images": None, "detector": None,
        "detector_labels": None, "depth_map": None, "png_unit": 0.001, "outputs": outputs(), "form": "table",
        "quiet": False, "strict": False, "names_evidence": False, "tree": None, "options": None,
    }  # fmt: skip
    return SimpleNamespace(**values | given)


def result(status: str = "resolved", **given: Any) -> Any:
    def save(file: Path, option: str, _schema: str | None = None) -> None:
        file.write_text(option)

    values = {
        "status": status, "warnings": ("dark images",), "save": save, "json": lambda: "{}", "evidence": (),
        "would_help": (), "curve": None, "scale": 0.5,
    }  # fmt: skip
    return SimpleNamespace(**values | given)


@pytest.fixture(autouse=True)
def _plain_tables(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    table = "metric_cli.estimate_scale.result_table"
    monkeypatch.setattr(f"{table}.csv_text", lambda _: "CSV\n")
    monkeypatch.setattr(f"{table}.headline", lambda _: "HEADLINE")
    monkeypatch.setattr(f"{table}.result_text", lambda _, wide: f"TABLE {wide}\n")


@pytest.mark.parametrize(
    ("form", "text"),
    [("json", "{}\n"), ("csv", "CSV\n"), ("quiet", "HEADLINE\n"), ("wide", "TABLE True\n"), ("table", "TABLE False\n")],
)
def test_forms_of_the_printed_result(form: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert estimate._report(result(), request(form=form)) == 0
    assert capsys.readouterr().out == text


@pytest.mark.parametrize(
    ("status", "strict", "expected"),
    [("resolved", True, 0), ("uncertain", False, 0), ("uncertain", True, 3), ("unresolved", False, 3)],
)
def test_the_exit_status_is_3_for_an_unresolved_scale(status: str, strict: bool, expected: int) -> None:
    assert estimate._report(result(status), request(strict=strict)) == expected


@pytest.mark.parametrize("quiet", [True, False])
def test_warnings_and_outputs_that_are_not_written_are_stated(quiet: bool, capsys: pytest.CaptureFixture[str]) -> None:
    given = request(quiet=quiet, form="quiet", outputs=outputs(output=Path("a.json"), write_scaled=Path("m")))
    estimate._report(result("unresolved"), given)
    error = capsys.readouterr().err
    assert ("warning: dark images" in error, "--output, --write-scaled: not written" in error) == (not quiet,) * 2
    assert not Path("a.json").exists()
    estimate._report(result("uncertain"), given)
    assert Path("a.json").read_text() == "--output"
    assert "not written" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("capture", "status", "before", "after"),
    [
        (object(), "resolved", None, "--work"),
        (None, "resolved", None, None),
        (object(), "unresolved", '{"schema": "metric-tree/scale/1"}', None),
        (object(), "unresolved", '{"schema": "mine"}', '{"schema": "mine"}'),
    ],
)
def test_a_work_folder_has_the_result_of_the_last_run(
    capture: object, status: str, before: str | None, after: str | None
) -> None:
    file = Path("result.json")
    if before is not None:
        file.write_text(before)
    estimate._report(result(status), request(capture=capture, work=Path()))
    assert (file.read_text() if file.exists() else None) == after


def help_with(option: str | None) -> Any:
    return SimpleNamespace(option=option, what="a height", narrows_by=0.4)


@pytest.mark.parametrize(
    ("given", "found", "line"),
    [
        ({"scene": None}, {}, None),
        ({"form": "json"}, {}, None),
        ({"form": "wide"}, {}, "--write-scaled s-metric  # the model in metres"),
        ({"scene": Path("/")}, {}, "--write-scaled /scene-metric  # the model in metres"),
        ({"scene": Path("/a/b/..")}, {}, "--write-scaled /a-metric  # the model in metres"),
        ({"outputs": outputs(write_scaled=Path("m"))}, {}, "--overlay sizes  # the images with sizes"),
        ({"scene": Path("there")}, {}, "--overlay sizes  # the images with sizes"),
        ({}, {"status": "uncertain"}, "--camera-height handheld  # or tripod, car, or a height such as 5ft"),
        ({}, {"status": "uncertain", "evidence": ("known_length",)}, "--trust-known-length  # if the length"),
        ({}, {"status": "unresolved", "evidence": ("camera_height",)}, None),
        ({}, {"status": "unresolved", "evidence": ("-camera_height",)}, "--camera-height handheld"),
        ({}, {"status": "uncertain", "would_help": (help_with(None), help_with("--gps F"))},
         "--gps F  # a height: interval 40% narrower"),
    ],
)  # fmt: skip
def test_the_next_command_is_the_most_helpful_one(
    given: dict[str, Any], found: dict[str, Any], line: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Kinds of evidence with a minus are outliers."""
    Path("there-metric").mkdir()
    kinds = found.pop("evidence", ())
    rows = [SimpleNamespace(kind=k.removeprefix("-"), verdict="outlier" if k[0] == "-" else "used") for k in kinds]
    estimate._notice_next_command(result(**{"evidence": rows, **found}), request(**given))
    error = capsys.readouterr().err
    found["evidence"] = kinds
    assert error == "" if line is None else error.startswith(f"estimate-scale: next: estimate-scale s {line}")


@pytest.mark.parametrize(
    ("status", "curve", "quiet", "drawable", "warns"),
    [
        ("resolved", None, False, True, False),
        ("unresolved", object(), False, True, False),
        ("unresolved", None, False, False, True),
        ("unresolved", None, True, False, False),
    ],
)
def test_a_result_without_a_posterior_is_not_drawn(
    status: str, curve: object, quiet: bool, drawable: bool, warns: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    given = request(quiet=quiet, outputs=outputs(figure=Path("a.png")))
    assert estimate._is_drawable(result(status, curve=curve), given) == drawable
    assert ("--figure: there is nothing to draw" in capsys.readouterr().err) == warns
    assert estimate._is_drawable(result(status, curve=curve), request()) == drawable
    assert capsys.readouterr().err == ""


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the outputs that are written."""
    names: list[str] = []
    for module, name in {
        "figure": "write_figure", "overlay": "write_overlays", "rescaled": "write_rescaled",
    }.items():  # fmt: skip
        monkeypatch.setattr(f"estimator.outputs.{module}.{name}", lambda *_, name=name: names.append(name))
    monkeypatch.setattr("estimator.outputs.rescaled.write_rescaled_cloud", lambda *_: names.append("cloud"))
    monkeypatch.setattr("estimator.views.scene_view.scene_view", lambda _: names.append("scene_view"))
    monkeypatch.setattr("estimator.views.raster.write_view", lambda *_: names.append("png"))
    monkeypatch.setattr("estimator.views.glb.write_glb", lambda *_: names.append("glb"))
    monkeypatch.setattr("estimator.views.window.show", lambda _: names.append("window"))
    return names


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, []),
        ({"figure": Path("a")}, ["write_figure"]),
        ({"overlay": Path("a")}, ["write_overlays"]),
        ({"view": True}, ["scene_view", "window"]),
        ({"view_png": Path("a")}, ["scene_view", "png"]),
        ({"view_glb": Path("a")}, ["scene_view", "glb"]),
        ({"write_scaled": Path("a")}, ["write_rescaled"]),
        ({"write_scaled": Path("a.PLY")}, ["cloud"]),
        ({"write_scaled": Path("a.npy")}, ["write_rescaled"]),
    ],
)
def test_requested_outputs_are_written(given: dict[str, Any], expected: list[str], written: list[str]) -> None:
    made: Any = SimpleNamespace(result=result(), scene=None)
    estimate._write_views(made, request(outputs=outputs(**given)))
    assert written == expected
    written.clear()
    made.result = result("unresolved", curve=object(), scale=None)
    estimate._write_views(made, request(outputs=outputs(**given)))
    assert written == [name for name in expected if name not in ("write_rescaled", "cloud")]
    written.clear()
    made.result = result("unresolved", scale=None)
    estimate._write_views(made, request(outputs=outputs(**given)))
    assert written == []


def test_the_current_folder_has_a_next_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    estimate._notice_next_command(result(), request(scene=Path()))
    assert f"--write-scaled {tmp_path}-metric  #" in capsys.readouterr().err


def test_a_depth_map_in_metres_is_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    monkeypatch.setattr("estimator.scene_formats.depth_files.read_depth", lambda *_: np.full((2, 3), 4.0))
    made: Any = SimpleNamespace(result=result(), scene=None)
    estimate._write_scaled(made, 0.5, Path("a.npy"), request(depth_map=Path("d.png")))
    depth = np.load("a.npy")
    assert (depth.dtype, depth.tolist()) == (np.float32, [[2.0] * 3] * 2)


class Work(SimpleNamespace):
    """A work folder without stages."""

    @contextmanager
    def lock(self) -> Iterator[None]:
        self.n_locks = getattr(self, "n_locks", 0) + 1
        yield


@pytest.mark.parametrize(
    ("given", "in_work", "files", "has_evidence", "expected"),
    [
        ({"detector": "a.onnx"}, False, [], False, None),
        ({"instances": Path("m.json")}, False, [], False, "m.json"),
        ({"detector": "a.onnx"}, True, [], False, "detected"),
        ({"instances": Path("m.json")}, True, ["m.json"], False, "copied"),
        ({"instances": Path("m.json")}, True, [], False, "m.json"),
        ({"instances": Path("m.json"), "categories": Path("c")}, True, ["m.json"], False, "m.json"),
        ({"instances": Path("bare.json")}, True, ["bare.json"], False, "bare.json"),
        ({}, True, ["s/instances.json"], False, "copied"),
        ({"scene": Path("v.mp4")}, True, ["v.mp4"], False, "drawn page"),
        ({"scene": Path("v.mp4")}, True, ["v.mp4"], True, None),
        ({"scene": Path("v.mp4"), "names_evidence": True}, True, ["v.mp4"], False, None),
        ({"scene": Path("v.mp4")}, True, ["v.mp4", "w/instances.json"], False, None),
        ({"scene": Path("v.mp4"), "draw_port": 0}, True, ["v.mp4", "w/instances.json"], True, "drawn page"),
        ({}, False, ["own"], False, None),
        ({}, False, [], False, "drawn page"),
        ({}, False, [], True, None),
        ({}, False, ["w/instances.json"], False, "w/instances.json"),
        ({}, False, ["own", "w/instances.json"], False, None),
        ({"draw_port": 8000}, False, ["own"], False, "drawn page"),
    ],
)
def test_masks_are_given_detected_drawn_or_those_of_an_earlier_run(
    given: dict[str, Any], in_work: bool, files: list[str], has_evidence: bool, expected: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    calls: list[str] = []
    for name in files:
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text("{}")
    if "s/instances.json" not in files:
        Path("s").mkdir(exist_ok=True)
    monkeypatch.setattr("capture.masks.instances_file.detect_stage", lambda *_: calls.append("detected"))
    monkeypatch.setattr(
        "capture.masks.instances_file.copy_dataset",
        lambda file, _: file.name != "bare.json" and not calls.append("copied"),
    )
    default = Path("own") if "own" in files else None
    monkeypatch.setattr("estimator.instances.instance_reader.default_instances", lambda _: default)
    monkeypatch.setattr(estimate, "_drawn_masks", lambda *_: calls.append("drawn page"))
    work: Any = Work(path=Path("w")) if in_work else None
    scene: Any = object()
    found = estimate._masks(request(work=Path("w"), **given), scene, work, has_evidence, lambda _: None)  # type: ignore[arg-type, return-value]
    assert (calls[0] if calls else found and str(found)) == expected


@pytest.mark.parametrize(
    ("has_frames", "port", "is_terminal", "in_work", "message"),
    [
        (False, 0, True, False, "--images DIR with '0.png' and others, then --draw"),
        (True, None, False, False, "masks by --draw (a local page), --detector auto"),
        (True, None, False, True, "the frames are in w/frames"),
        (True, None, True, False, None),
        (True, 8000, False, False, None),
        (True, 8000, False, True, None),
    ],
)
def test_masks_are_drawn_on_request_or_at_a_terminal(
    has_frames: bool, port: int | None, is_terminal: bool, in_work: bool, message: str | None,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    saved: list[Any] = []
    pages: list[tuple[Any, ...]] = []

    def page(*arguments: Any) -> Any:
        pages.append(arguments)
        return SimpleNamespace(url="http://here", collect=lambda: {"drawn": 1})

    store = Work(path=Path("w"))
    monkeypatch.setattr("capture.masks.drawing_page.frames_to_draw", lambda *_: ["a"] * has_frames)
    monkeypatch.setattr("capture.masks.drawing_page.MaskPage", page)
    monkeypatch.setattr("capture.masks.instances_file.save_drawing", lambda drawing, _: saved.append(drawing))
    monkeypatch.setattr("capture.work_folder.WorkFolder", lambda _: store)
    monkeypatch.setattr("estimator.reconstructions.image_files.image_folders", lambda *_: ())
    monkeypatch.setattr("metric_tree.open", lambda _: None)
    for stream in (sys.stdin, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: is_terminal, raising=False)
    scene: Any = SimpleNamespace(views=[SimpleNamespace(name="0.png")])
    given = request(work=Path("w"), draw_port=port)
    work: Any = store if in_work else None
    if message is not None:
        with pytest.raises(InputError) as error:
            estimate._drawn_masks(given, scene, work, lambda _: None)  # type: ignore[arg-type, return-value]
        assert message in str(error.value)
        example = "--draw" if has_frames else "--camera-height handheld"
        assert f"such as: estimate-scale s {example} (" in str(error.value)
        return
    found = estimate._drawn_masks(given, scene, work, lambda _: None)  # type: ignore[arg-type, return-value]
    assert found == (None if in_work else Path("w/instances.json"))
    assert saved == [{"drawn": 1}]
    assert pages[0][4] == (port or 0)
    assert getattr(store, "n_locks", 0) == (not in_work)
    error_text = capsys.readouterr().err
    assert "outline and name the objects on http://here" in error_text
    assert ("or let a detector find them" in error_text) == (port is None)


@pytest.mark.parametrize(
    ("form", "is_terminal", "limit", "work"),
    [("json", False, None, "w"), ("table", True, None, "s.metric-tree"), ("table", True, 60.0, "w")],
)
def test_a_capture_that_cannot_be_used_has_a_code(
    form: str, is_terminal: bool, limit: float | None, work: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def reconstruct(*_: Any) -> None:
        raise CaptureFailure(Failure("no_texture", "a white wall"))

    monkeypatch.setattr("capture.pipeline.reconstruct", reconstruct)
    monkeypatch.setattr("capture.work_folder.WorkFolder", lambda path: Work(path=path))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal, raising=False)
    given = request(form=form, capture=SimpleNamespace(max_time_s=limit), work=Path(work))
    assert estimate.run(given) == 3
    captured = capsys.readouterr()
    assert "no_texture: a white wall" in captured.err
    assert ("time limit: 60 s (--max-time)" in captured.err) == (limit is not None)
    assert ("per frame (--max-time)" in captured.err) == (is_terminal and limit is None)
    assert ("work folder: s.metric-tree" in captured.err) == work.startswith("s.")
    record = json.loads(captured.out) if captured.out else None
    failure = {"code": "no_texture", "message": "a white wall"}
    expected = {"schema": "metric-tree/scale/1", "status": "unresolved", "failure": failure}
    assert record == (expected if form == "json" else None)
