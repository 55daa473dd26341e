"""The page on which objects are put into an image, in a real browser."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from insertion.request import ObjectRequest, PixelPosition
from metric_cli.insert_object.insert import command_line
from tests.support.browser import Browser
from tests.support.processes import started
from tests.synthetic.insertions import first_views, write_glb
from tests.synthetic.rooms.solids import box

ROOM = Path("data/scenes/demo_room").resolve()
CODE = "import sys; from metric_cli.insert_object.insert import main; sys.exit(main(sys.argv[1:]))"
#: Of the canvas: its left upper corner in the window, and how many of its pixels a pixel of the window is.
CANVAS = """(() => { const b = find("picture").getBoundingClientRect();
  return [b.left, b.top, find("picture").width / b.width] })()"""


def test_an_object_is_dragged_drawn_and_put_there_by_the_command(tmp_path: Path) -> None:
    room = first_views(ROOM, 6, tmp_path / "room")
    model = str(tmp_path / "box.glb")
    write_glb(box((-0.3, 0.3), (-0.15, 0.15), (0, 0.5), "wood"), Path(model))
    words = [str(room), "--scale", "0.4", "--model", model, "--at", "auto", "--model", model, "--size=height=0.2"]
    program = [sys.executable, "-c", CODE]
    with (
        started([*program, *words, "--place"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child,
        Browser(tmp_path / "profile") as browser,
    ):
        try:
            assert child.stderr is not None
            url = next(line.split()[-1] for line in child.stderr if "http://" in line)  # after progress, if slow
            browser.open(url, "document.body && document.body.dataset.ready")
            assert browser.run("find('frame').options.length") >= 3
            left, top, times = browser.run(CANVAS)

            def at(x: float, y: float) -> tuple[float, float]:
                return left + x / times, top + y / times

            browser.click(at(5, 5))  # a wall
            browser.wait("find('says').className === 'refused'")
            assert browser.run("find('done').disabled")
            width, height = browser.run("[find('picture').width, find('picture').height]")
            browser.drag(at(0.5 * width, 0.9 * height), at(0.45 * width, 0.85 * height))
            browser.wait("!find('done').disabled")
            first = browser.run("find('command').textContent")
            assert "--facing 0" in first
            assert first.count("--at frame=") == 1  # the second object is in free space
            browser.run("find('object').value = 1; find('object').dispatchEvent(new Event('change'))")
            browser.click(at(0.62 * width, 0.75 * height))
            browser.wait("find('command').textContent.split('--at frame=').length === 3")
            browser.run("find('object').value = 0; find('object').dispatchEvent(new Event('change'))")
            browser.run("find('turn').value = 45; turned()")
            browser.wait("find('command').textContent.includes('--facing 45')")
            browser.call("Emulation.setDeviceMetricsOverride", width=360, height=740, deviceScaleFactor=1, mobile=True)
            browser.run("find('model').textContent = 'a_long_name_of_a_file_of_a_model.glb'")
            assert browser.run("document.documentElement.scrollWidth") == 360  # a telephone shows all of it
            browser.run("find('done').click()")
            browser.wait("find('says').textContent.startsWith('Done')")
            command = browser.run("find('command').textContent")
            printed, _ = child.communicate(timeout=300)
        finally:
            child.kill()
    assert printed == command + "\n"
    out = tmp_path / "out"
    repeated = shlex.split(command.replace("OUT.mp4", str(out)))
    assert repeated[0] == "insert-object"
    subprocess.run([*program, *repeated[1:], "--frames", "0:0"], check=True, timeout=300, capture_output=True)
    (picture,) = out.iterdir()
    plain = cv2.imread(str(next(ROOM.rglob(f"{picture.stem}.*"))))
    changed = np.abs(cv2.imread(str(picture)).astype(int) - plain).max(axis=-1) > 30
    rows, columns = np.nonzero(changed)
    assert abs(np.median(columns) - 0.45 * plain.shape[1]) < 0.1 * plain.shape[1]
    assert rows.max() > 0.75 * plain.shape[0]


@pytest.mark.parametrize("before", [["--at", "auto", "--place"], ["--place", "8001", "--facing=wall"], ["--on", "a b"]])
def test_the_command_has_one_place(before: list[str]) -> None:
    request = ObjectRequest(Path("m.glb"), at=PixelPosition("0 1.png", 3.25, 4.0), facing=-30.0)
    argv = ["scene", "--model", "m.glb", *before, "--size", "height=2"]
    assert shlex.split(command_line([request], argv, has_out=True)) == [
        "insert-object", "scene", "--model", "m.glb", "--at", "frame=0 1.png,x=3.2,y=4.0", "--facing", "-30",
        "--size", "height=2",
    ]  # fmt: skip


def test_the_command_keeps_the_positions_that_are_no_pixels() -> None:
    stool = ObjectRequest(Path("b.glb"), plane=2)
    chair = ObjectRequest(Path("a.glb"), at=PixelPosition("7.png", 3.0, 4.0), facing="wall")
    argv = ["scene", "--model=b.glb", "--plane", "2", "--place", "--model=a.glb", "--at", "auto", "--facing=12"]
    assert shlex.split(command_line([stool, chair], argv, has_out=False)) == [
        "insert-object", "scene", "--model=b.glb", "--plane", "2",
        "--model=a.glb", "--at", "frame=7.png,x=3.0,y=4.0", "--facing", "wall", "--out", "OUT.mp4",
    ]  # fmt: skip
