"""The drawing page in a real browser, and requests that its server refuses."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

import metric_tree
from capture.masks.drawing_page import Estimator, MaskPage, frames_to_draw, name_meaning
from estimator.records.scene import Camera, Scene, View
from metric_base.errors import InputError
from tests.support.browser import Browser

NAMES = [f"{k:06d}.jpg" for k in range(8)]


def _scene(folder: Path) -> Scene:
    camera = Camera("PINHOLE", 320, 240, np.array([250.0, 250.0, 160.0, 120.0]))
    folder.mkdir(exist_ok=True)
    views = []
    for k, name in enumerate(NAMES):
        cv2.imwrite(str(folder / name), np.full((240, 320, 3), 20 * k, dtype=np.uint8))
        seen = np.arange(k % 3 + 1)
        views.append(View(name, camera, np.eye(3), np.zeros(3), np.zeros((len(seen), 2)), seen))
    return Scene(folder, "memory", tuple(views), np.zeros((3, 3)))


def end(page: MaskPage) -> None:
    """Close the socket of a page that was never served."""
    page.finish()
    page.end_if_last()
    page.serve()


class _Served:
    """A page that is served in a thread; `document` is its result."""

    def __init__(self, folder: Path, estimate: Estimator | None = None) -> None:
        names = partial(name_meaning, metric_tree.open())
        frames = frames_to_draw(_scene(folder / "frames"), (folder / "frames",))
        self.page = MaskPage(frames, ["chair"], folder / "d.json", names, estimate=estimate)
        self.document: dict[str, Any] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.document = self.page.collect()

    def drawing(self) -> dict[str, Any]:
        self._thread.join(300)
        assert self.document is not None
        return self.document

    def request(self, path: str, body: str | None = None, host: str | None = None) -> tuple[int, str]:
        url = urlsplit(self.page.url)
        assert url.hostname is not None
        connection = http.client.HTTPConnection(url.hostname, url.port, timeout=120)
        headers = {} if host is None else {"Host": host}
        connection.request("GET" if body is None else "POST", path, body=body, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode("utf-8", "replace")

    def at(self, path: str) -> str:
        return urlsplit(self.page.url).path + path


@pytest.fixture
def served(tmp_path: Path) -> Iterator[_Served]:
    served = _Served(tmp_path)
    yield served
    if served.document is None:
        objects = [{"name": "x", "kind": "box", "points": [[0, 0], [9, 9]]}]
        images = [{"name": frame["name"], "objects": objects} for frame in served.page.start()["frames"]]
        answer = served.request(served.at("save"), json.dumps({"images": images, "done": True}))
        assert answer[0] == 200, answer  # otherwise the page waits for another drawing
        served.drawing()


def test_a_person_draws_a_box_and_a_polygon(served: _Served, tmp_path: Path) -> None:
    """With the mouse and the keyboard: names are judged while they are typed, and the last step is undone."""
    with Browser(tmp_path / "profile") as browser:
        browser.open(served.page.url, "document.body?.dataset.ready === 'yes'")
        box = browser.run(
            "(b => [b.left, b.top, b.width / 320])(document.getElementById('picture').getBoundingClientRect())"
        )

        def at(x: float, y: float) -> tuple[float, float]:
            return box[0] + x * box[2], box[1] + y * box[2]

        browser.drag(at(40, 30), at(140, 200))
        browser.type("swivl chiar")
        browser.wait("document.getElementById('says').textContent.includes('did you mean')")
        browser.run("document.getElementById('name').value = ''")
        browser.type("chair")
        browser.wait("document.getElementById('says').textContent.startsWith('chair: usually length')")
        browser.press("Enter")
        browser.wait("document.querySelectorAll('#objects li').length === 1")
        assert "as boxes it needs 3" in browser.run("document.getElementById('all').textContent")
        browser.press("ArrowRight")
        browser.press("ArrowRight")
        browser.press("p")
        for corner in ((10, 10), (100, 20), (90, 90), (60, 120)):
            browser.click(at(*corner))
            if corner == (90, 90):
                browser.press("Backspace")
        browser.press("Enter")
        browser.type("<b>vase</b>")  # a name is text, whatever is in it
        browser.press("Enter")
        browser.wait("document.querySelectorAll('#objects li').length === 1")
        assert browser.run("document.querySelector('#objects span').innerHTML") == "&lt;b&gt;vase&lt;/b&gt;"
        browser.press("b")
        browser.drag(at(200, 30), at(300, 200))
        browser.wait("document.querySelector('#used button')?.textContent === 'chair'")
        browser.run("document.querySelector('#used button').click()")
        browser.wait("document.querySelectorAll('#objects li').length === 2")
        browser.run("document.getElementById('undo').click()")
        browser.wait("document.querySelectorAll('#objects li').length === 1")
        browser.run("document.getElementById('done').click()")  # one box, and a name that nobody knows
        browser.wait("document.getElementById('message').textContent.includes('Press again')")
        browser.run("document.getElementById('done').click()")
        browser.wait("document.body.textContent.startsWith('Thank you')")
    document = served.drawing()
    first, second = document["annotations"]
    names = {row["id"]: row["name"] for row in document["categories"]}
    assert [names[row["category_id"]] for row in (first, second)] == ["chair", "<b>vase</b>"]
    np.testing.assert_allclose(first["bbox"], [40, 30, 100, 170], atol=1.5)
    assert "segmentation" not in first
    np.testing.assert_allclose(second["segmentation"][0], [10, 10, 100, 20, 60, 120], atol=1.5)
    assert second["image_id"] == 3
    assert len(document["images"]) == 5


def test_the_page_ends_with_the_answer_and_lets_one_draw_on(tmp_path: Path) -> None:
    """Missing masks, the table and the figure; after a second drawing the page is closed."""
    estimated: list[int] = []

    def estimate(document: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        estimated.append(len(document["annotations"]))
        rows = [["chair 1", "measured", "0.50 × 0.50 × 0.90", "0.48", "used: <b>"]]
        missing = ["would help: two more images of the chair 1"]
        columns = ["object", "tier", "metres", "own scale", "verdict"]
        record = {"headline": f"scale {len(estimated)}", "columns": columns, "rows": rows, "missing": missing}
        return record, cv2.imencode(".png", np.zeros((20, 30, 3), np.uint8))[1].tobytes()

    served = _Served(tmp_path, estimate)
    with Browser(tmp_path / "profile") as browser:
        browser.open(served.page.url, "document.body?.dataset.ready === 'yes'")
        left, top, pixel = browser.run(
            "(b => [b.left, b.top, b.width / 320])(document.getElementById('picture').getBoundingClientRect())"
        )

        def draw_box(x: float) -> None:
            browser.drag((left + x * pixel, top + 30 * pixel), (left + (x + 80) * pixel, top + 150 * pixel))
            browser.type("chair")
            browser.press("Enter")

        def ask() -> None:
            browser.run("document.getElementById('done').click()")
            browser.wait("document.getElementById('message').textContent.includes('Press again')")
            browser.run("document.getElementById('done').click()")

        draw_box(20)
        browser.wait("document.querySelectorAll('#objects li').length === 1")
        ask()
        browser.wait("document.getElementById('headline').textContent === 'scale 1'")
        assert browser.run("document.querySelector('main').hidden")
        assert browser.run("document.getElementById('missing').textContent").startswith("would help")
        assert browser.run("document.querySelectorAll('#rows td')[4].textContent") == "used: <b>"
        browser.wait("document.getElementById('figure').naturalWidth === 30")
        browser.run("document.getElementById('on').click()")
        assert browser.run("document.getElementById('answer').hidden")
        draw_box(150)
        browser.wait("document.querySelectorAll('#objects li').length === 2")
        browser.run("document.getElementById('done').click()")
        browser.wait("document.getElementById('headline').textContent === 'scale 2'")
        assert served.document is None, "the page goes on until it is closed"
        browser.run("document.getElementById('close').click()")
        browser.wait("document.body.textContent.startsWith('Thank you')")
    assert (estimated, len(served.drawing()["annotations"])) == ([1, 2], 2)


def test_a_name_is_judged(served: _Served) -> None:
    status, said = served.request(served.at("name/swivel%20chair"))
    meaning = json.loads(said)
    assert (status, meaning["known"], meaning["offers"][0]) == (200, True, "swivel chair")
    assert meaning["says"].startswith("swivel chair: usually ")
    assert not json.loads(served.request(served.at("name/qqq%FF"))[1])["known"]
    assert "200 characters" in json.loads(served.request(served.at("name/" + "a" * 999))[1])["says"]


def test_frames_are_spread_and_see_much(tmp_path: Path) -> None:
    frames = frames_to_draw(_scene(tmp_path / "frames"), (tmp_path / "frames",))
    assert [frame.name for frame in frames] == ["000001.jpg", "000002.jpg", "000005.jpg", "000006.jpg", "000007.jpg"]


def test_an_interrupted_drawing_is_kept(served: _Served, tmp_path: Path) -> None:
    objects = [{"name": "cup", "kind": "box", "points": [[5, 5], [50, 60]]}]
    body = json.dumps({"images": [{"name": "000001.jpg", "objects": objects}], "done": False})
    assert served.request(served.at("save"), body)[0] == 200
    again = MaskPage(frames_to_draw(_scene(tmp_path / "frames"), (tmp_path / "frames",)), [], tmp_path / "d.json")
    assert again.start()["frames"][0]["objects"] == objects
    end(again)


def test_a_drawing_of_many_objects_is_kept_again(served: _Served, tmp_path: Path) -> None:
    objects = [{"name": "cup", "kind": "box", "points": [[5, 5], [50 + k, 60]]} for k in range(20)]
    for count in (19, 20):  # the first draft is longer than the bytes in which a schema is searched
        images = [{"name": "000001.jpg", "objects": objects[:count]}]
        assert served.request(served.at("save"), json.dumps({"images": images, "done": False})) == (200, "{}")
    again = MaskPage(frames_to_draw(_scene(tmp_path / "frames"), (tmp_path / "frames",)), [], tmp_path / "d.json")
    assert len(again.start()["frames"][0]["objects"]) == 20
    end(again)


@pytest.mark.parametrize(
    "content", ["[" * 200_000, "[3]", '{"frames": {"000001.jpg": 3}}', '{"frames": 3}', "a user's"]
)
def test_a_draft_that_is_no_drawing_is_not_replaced(tmp_path: Path, content: str) -> None:
    frames = frames_to_draw(_scene(tmp_path / "frames"), (tmp_path / "frames",))
    (tmp_path / "d.json").write_text(content)
    with pytest.raises(InputError, match=r"drawing|JSON"):
        MaskPage(frames, [], tmp_path / "d.json")
    assert (tmp_path / "d.json").read_text() == content


def _body(objects: object, name: str = "000001.jpg") -> str:
    return json.dumps({"images": [{"name": name, "objects": objects}]})


@pytest.mark.parametrize(
    ("body", "word"),
    [
        ("[]", "Expected `object`"),
        ("{", ""),
        (_body([], "../etc/passwd"), "frames of this page"),
        (_body([{"kind": "box", "name": " ", "points": []}]), "needs a name"),
        (_body([{"kind": "box", "name": "a", "points": [[1, 1]]}]), "corners"),
        (_body([{"kind": "box", "name": "a", "points": "x"}]), "Expected `array`"),
        (_body([{"kind": "box", "name": "a", "points": [[1, 1], [int("9" * 400), 2]]}]), "out of range"),
        (_body([{"kind": "polygon", "name": "a", "points": [[1, 1], [9, 9]]}]), "3 or more corners"),
        (_body([{"kind": "box", "name": "a", "points": [[1, 1], [2, 2]]}]), "smaller"),
        (_body(3), "Expected `array`"),
        ('{"images": [], "done": true}', "at least one object"),
    ],
)
def test_what_is_no_drawing_is_refused(served: _Served, body: str, word: str) -> None:
    status, answer = served.request(served.at("save"), body)
    assert status == 400
    assert word in json.loads(answer)["error"]
    assert served.document is None


@pytest.mark.parametrize(
    ("name", "side", "status"), [("a" * 200, 2.0, 200), ("a" * 201, 2.0, 400), ("a", 1.9, 400), ("", 2.0, 400)]
)
def test_a_name_has_at_most_200_characters_and_an_object_two_pixels(
    served: _Served, name: str, side: float, status: int
) -> None:
    drawn = [{"kind": "box", "name": name, "points": [[1, 1], [9, 1 + side]]}]
    assert served.request(served.at("save"), _body(drawn))[0] == status


def test_nobody_else_gets_in(served: _Served) -> None:
    assert served.request("/")[0] == 404
    assert served.request("/start")[0] == 404
    assert served.request(served.at(""), host="evil.example")[0] == 404
    assert served.request(served.at("frame/99"))[0] == 404
    assert served.request(served.at("frame/../start"))[0] == 404
    assert served.request(served.at("frame/1"))[0] == 200
    assert served.page.url.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    "request_lines",
    [
        "GET {at}frame/0",
        "GET {at}frame/" + "9" * 5000,
        "POST {at}save\r\nContent-Length: " + "9" * 5000,
        "GET {at}\r\n\r\n",
    ],
    ids=["tab closed", "digits", "length", "half"],
)
def test_a_browser_that_hangs_up_is_not_heard_in_the_terminal(
    served: _Served, request_lines: str, capfd: pytest.CaptureFixture[str]
) -> None:
    url = urlsplit(served.page.url)
    head, _, rest = request_lines.format(at=url.path).partition("\r\n")
    text = f"{head} HTTP/1.1\r\nHost: {url.netloc}\r\n{rest}\r\n\r\n"
    with socket.create_connection((str(url.hostname), int(url.port or 0)), timeout=120) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # hang up with a reset
        connection.sendall(text.encode())
    assert served.request(served.at(""))[0] == 200
    assert capfd.readouterr().err == ""


def test_a_drawing_that_cannot_be_kept_is_said_in_the_page(served: _Served, tmp_path: Path) -> None:
    (tmp_path / "d.json").mkdir()
    status, said = served.request(served.at("save"), _body([]))
    assert (status, "cannot be kept" in said) == (500, True)
    (tmp_path / "d.json").rmdir()
