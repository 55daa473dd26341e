"""The pages in a real browser: search, compare, scale, the form of files, obstacles, narrow windows."""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest

import metric_tree
from estimator.views.glb import glb_bytes
from explorer.catalogue import ReleaseCatalogue
from explorer.fit import fit_response
from explorer.routes import render
from explorer.schemas import FitQuery
from tests.support.browser import Browser
from tests.support.views import hand_view

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    "index.html", "tree.html", "about.html", "compare.html?nodes=swivel_chair.n.01,mt-bar_stool", "scale.html",
    "search.html?q=chair", "sources/index.html", "sources/made.html", "vocabularies/index.html",
    "vocabularies/coco_80.html",
    "changes/0.0.1.html", "nodes/swivel_chair.n.01.html", "nodes/entity.n.01.html",
]  # fmt: skip
#: Errors of the page are kept, and nothing is requested of any other machine.
WATCH = """
window.problems = [];
addEventListener("error", (event) => problems.push(String(event.message || event.target.src)), true);
addEventListener("unhandledrejection", (event) => problems.push(String(event.reason)));
addEventListener("securitypolicyviolation", (event) => problems.push(event.violatedDirective));
const error = console.error; console.error = (...words) => { problems.push(words.join(" ")); error(...words); };
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as one:
        one.call("Page.enable")
        one.call("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        one.call("Network.enable")
        outside = ["*://*:443/*", "https://*", "http://*.com/*", "http://*.org/*", "http://*.net/*", "http://*.edu/*"]
        one.call("Network.setBlockedURLs", urls=outside)
        yield one


def axe() -> str:
    """The source of axe-core: of npm where it is installed, else of a package of Python's index."""
    local = ROOT / "node_modules" / "axe-core" / "axe.min.js"
    if local.is_file():
        return local.read_text(encoding="utf-8")
    found = find_spec("axe_core_python")
    if found is None or found.origin is None:
        pytest.skip("no axe-core; `npm install axe-core` or `pip install axe-core-python`")
    return (Path(found.origin).parent / "axe.min.js").read_text(encoding="utf-8")


def see(browser: Browser, address: str, width: int = 1200) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=False)
    browser.open(address)


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_page_has_an_error_or_an_obstacle(base: str, browser: Browser, scheme: str, width: int) -> None:
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    source, found = axe(), {}
    for page in PAGES:
        see(browser, f"{base}/{page}", width)
        browser.run(source + ";0")
        asked = "axe.run({resultTypes: ['violations']}).then(r => r.violations.map(v => "
        obstacles = browser.run(asked + "v.id + ' ' + v.nodes[0].html.slice(0, 120)))")
        obstacles += browser.run("problems")
        if obstacles:
            found[page] = obstacles
    assert found == {}


def test_no_page_scrolls_sideways_on_a_telephone(base: str, browser: Browser) -> None:
    wide = {}
    for page in PAGES:
        see(browser, f"{base}/{page}", width=360)
        if (width := browser.run("document.documentElement.scrollWidth")) > 360:
            wide[page] = width
    assert wide == {}


def test_no_drawing_scrolls_sideways_on_a_telephone(base: str, browser: Browser, catalogue: ReleaseCatalogue) -> None:
    """Six objects beside a person and a door have numbers, which a list explains."""
    six = [name for name, node in catalogue.by_slug.items() if catalogue.dims(node)][:6]
    inner = "[...document.querySelectorAll('main *')].filter(one => one.scrollWidth > one.clientWidth + 1 && "
    inner += "['auto', 'scroll'].includes(getComputedStyle(one).overflowX)).length"
    for page in (f"compare.html?nodes={','.join(six)}", "tree.html"):
        see(browser, f"{base}/{page}", width=390)
        assert browser.run(inner) == 0, page
        assert browser.run("document.documentElement.scrollWidth") <= 390
    see(browser, f"{base}/compare.html?nodes={','.join(six)}", width=390)
    assert browser.run("[...document.querySelectorAll('#front .name')].map(one => one.textContent)") == [*"12345678"]
    assert browser.run("document.querySelectorAll('#numbered li').length") == 8
    assert browser.run("document.querySelector('#front .movable .object').width.baseVal.value") > 10


@pytest.mark.parametrize("form", ["served", "files"])
def test_search_as_you_type(base: str, site: Path, browser: Browser, form: str) -> None:
    home = f"{base}/index.html" if form == "served" else (site / "index.html").as_uri()
    see(browser, home)
    browser.run("document.getElementById('search').focus()")
    expected = {
        "swivel": "swivel chair", "swivle chair": "swivel chair", "desk chair": "swivel chair", "coco mouse": "mouse",
        "trackbal": "trackball",
    }  # fmt: skip
    browser.type("a")
    browser.wait("window.metricTree.search")
    for text, name in expected.items():
        hits = browser.run(f"metricTree.search({json.dumps(text)}).map(hit => hit.name)")
        assert hits[0] == name, (text, hits)
    assert browser.run("metricTree.search('made').map(hit => hit.name)")[-1] == "made for tests"
    browser.run("document.getElementById('search').value = ''")
    browser.type("bar st")
    browser.wait("document.querySelector('#hits [id=hit-0]')?.textContent.includes('bar stool')")
    assert " high" in browser.run("document.getElementById('hit-0').textContent")
    browser.press("Enter")
    browser.wait("document.querySelector('#results li')?.textContent.includes('bar stool')")
    text = browser.run("document.querySelector('#search-answer').textContent")
    assert text == 'No category is called "bar st". Similar names:'
    see(browser, home.replace("index.html", "search.html?q=how+tall+is+a+bar+stool"))
    browser.wait("document.querySelector('#search-answer')?.textContent.startsWith('bar stool: about ')")
    assert browser.run("problems") == []
    browser.run("document.getElementById('search').focus()")
    browser.press("ArrowDown")
    browser.press("Enter")
    browser.wait("document.querySelector('h1')?.textContent == 'bar stool'")


def choose_unit(browser: Browser, unit: str) -> None:
    browser.run(f"document.getElementById('units').value = '{unit}'")
    browser.run("document.getElementById('units').dispatchEvent(new Event('change'))")


def test_compare_is_a_scene_to_scale(base: str, browser: Browser, catalogue: ReleaseCatalogue) -> None:
    """Boxes have the ratio of the median sizes, keys and drags move them, and the address keeps the choice."""
    see(browser, f"{base}/compare.html?nodes=swivel_chair.n.01")
    browser.run("document.getElementById('add-name').value = 'computer mouse'")
    browser.run("document.getElementById('add').requestSubmit()")
    browser.wait("document.querySelectorAll('#compared tbody tr').length == 2")
    assert browser.run("location.search") == "?nodes=swivel_chair.n.01,mouse.n.04"
    names = "[...document.querySelectorAll('#front .name')].map(one => one.textContent)"
    assert browser.run(names) == ["swivel chair", "mouse", "person", "door"]
    box = "document.querySelector('#%s .movable .object').%s.baseVal.value"
    medians = catalogue.quantiles(catalogue.nodes["swivel_chair.n.01"])[2]  # length, width, height
    drawn = [browser.run(box % size) for size in (("front", "width"), ("top", "height"), ("front", "height"))]
    assert np.allclose(np.array(drawn) / drawn[0], medians / medians[0], rtol=0.01)
    place = "document.querySelector('#front .movable').getAttribute('transform')"
    before = browser.run(place)
    browser.run("document.querySelector('#front .movable').focus()")
    browser.press("ArrowRight")
    assert browser.run(place) != before
    browser.run("document.querySelector('#references input').click()")
    assert browser.run(names) == ["swivel chair", "mouse", "door"]
    assert browser.run(place) != before, "an object that was moved stays"
    choose_unit(browser, "ft")
    assert browser.run("document.querySelector('#compared data').textContent").endswith("″")
    assert browser.run("document.querySelector('#front .movable text').textContent").endswith("″ wide")
    choose_unit(browser, "auto")


def test_one_known_dimension_is_a_bar_and_an_unknown_one_is_not_drawn(base: str, browser: Browser) -> None:
    see(browser, f"{base}/compare.html")
    browser.run("MT_SIZES['rat.n.01'][3] = {height: [1, 1500, 2000]}")
    browser.run("document.getElementById('add-name').value = 'rat'")
    browser.run("document.getElementById('add').requestSubmit()")
    browser.wait("document.querySelector('#front .movable .object')")
    assert browser.run("document.querySelector('#front .movable .object').width.baseVal.value") < 10
    assert browser.run("document.querySelector('#front .movable .object').height.baseVal.value") > 100
    assert browser.run("document.querySelector('#top .movable').querySelectorAll('rect.object').length") == 0


@pytest.mark.parametrize(
    ("names", "how"),
    [
        (("swivel chair", "70 x 200 cm"), "through"),
        (("mouse", "swivel chair"), "in"),
        (("65 x 60 x 99 cm", "swivel chair"), "in"),
    ],
)
def test_the_page_and_the_server_agree_on_whether_an_object_fits(
    base: str, browser: Browser, catalogue: ReleaseCatalogue, names: tuple[str, str], how: str
) -> None:
    expected = fit_response(catalogue, FitQuery(*names))
    assert expected.how == how
    see(browser, f"{base}/compare.html?object={quote(names[0])}&into={quote(names[1])}")
    browser.wait("document.getElementById('fit-answer').textContent.includes('%')")
    shown = int(browser.run("document.getElementById('fit-answer').textContent").split()[-5])
    assert expected.probability is not None
    assert abs(shown / 100 - expected.probability) < 0.0051, "the same pairs, rounded"
    assert browser.run("document.getElementById('fit-reason').textContent").strip() == expected.reason
    is_bound = browser.run("document.getElementById('fit-answer').textContent.includes('in at most')")
    assert is_bound == expected.is_upper_bound == (how == "in")


def test_the_unit_changes_sentences_tables_axes_and_drawings(base: str, browser: Browser) -> None:
    see(browser, f"{base}/nodes/swivel_chair.n.01.html")
    metric = (
        "[...document.querySelectorAll('main *')]"
        ".filter(one => !one.children.length && !one.closest('tbody th, code'))"
        ".map(one => one.textContent).filter(text => /\\d (cm|mm|m)\\b/.test(text))"
    )
    before = browser.run(metric)
    assert len(before) > 30
    for unit, mark in (("in", " in"), ("ft", "″")):
        choose_unit(browser, unit)
        assert browser.run(metric) == []
        for part in (
            ".sentence",
            ".five td",
            ".distribution .axis text",
            ".scatter .vertical text",
            ".to-scale text.start",
        ):
            assert mark in browser.run(f"document.querySelector('{part}').textContent"), (unit, part)
        assert mark in browser.run("document.querySelector('.to-scale').getAttribute('aria-label')")
    choose_unit(browser, "auto")
    assert browser.run(metric) == before
    assert browser.run("metricTree.converted('A mug is 9.5 cm high, of 8 to 12 cm.', 'in')") == (
        "A mug is 3.74 in high, of 3.15 to 4.72 in."
    )
    texts = (
        "[[1700, 0], [304.8, 0], [4564, 914], [45, 0]].map(([mm, typical]) => metricTree.lengthText(mm, 'ft', typical))"
    )
    assert browser.run(texts) == ["5′ 7″", "1′ 0.0″", "14′ 11.7″", "1.77″"]


def test_the_scale_page_reads_objects_and_computes_on_a_server(base: str, browser: Browser) -> None:
    see(browser, f"{base}/scale.html")
    objects = [{"id": "seat", "category": "swivel chair", "dimensions": {"height": 0.525}}]
    text = json.dumps({"schema": "metric-tree/objects/1", "objects": objects})
    drop = f"""(() => {{ const data = new DataTransfer();
        data.items.add(new File([{json.dumps(text)}], "objects.json"));
        document.getElementById("drop").dispatchEvent(new DragEvent("drop", {{ dataTransfer: data }})); }})()"""
    browser.run(drop)
    browser.wait("document.querySelector('#posterior rect')")
    low, high = map(
        float, browser.run("document.querySelector('#objects tbody td:nth-child(4)').textContent").split(" to ")
    )
    assert low < 2 < high
    browser.run("document.getElementById('compute').click()")
    browser.wait("document.getElementById('headline').textContent.includes('metres per unit')")
    assert browser.run("problems") == []


def test_the_outline_opens_by_keys_and_tables_sort(base: str, browser: Browser) -> None:
    see(browser, f"{base}/tree.html")
    browser.run("document.querySelector('#outline details a').focus()")
    browser.press("ArrowRight")
    assert browser.run("document.querySelector('#outline details details').open")
    see(browser, f"{base}/nodes/swivel_chair.n.01.html")
    browser.run("document.querySelectorAll('#items thead button')[3].click()")
    rows = "[...document.querySelectorAll('#items tbody tr')]"
    heights = browser.run(rows + ".map(row => +row.cells[3].querySelector('data').value)")
    assert heights == sorted(heights)
    assert len(heights) == 14


def drop_file(browser: Browser, name: str, data: bytes) -> None:
    """Let a file fall on the scale page."""
    text = base64.b64encode(data).decode()
    browser.run(f"""(() => {{ const data = new DataTransfer();
        const bytes = Uint8Array.from(atob("{text}"), (letter) => letter.charCodeAt(0));
        data.items.add(new File([bytes], "{name}"));
        document.getElementById("drop").dispatchEvent(new DragEvent("drop", {{ dataTransfer: data }})); }})()""")


def test_a_scene_in_three_dimensions(site: Path, browser: Browser) -> None:
    """From the disk: drawn, a click on a box states its reason, and so does its button; a broken file is an error."""
    see(browser, (site / "scale.html").as_uri())
    drop_file(browser, "scene.glb", glb_bytes(hand_view()))
    browser.wait("metricTree.view3d?.boxes().length == 3")
    browser.wait("document.getElementById('view3d').width > 300")
    pen = "document.getElementById('view3d').getContext('2d')"
    size = "document.getElementById('view3d').width, document.getElementById('view3d').height"
    counted = f"{pen}.getImageData(0, 0, {size}).data.reduce((sum, value, k) => sum + (k % 4 == 3 && value > 0), 0)"
    browser.wait(f"{counted} > 3000")
    browser.run("document.getElementById('view3d').scrollIntoView()")
    frame = browser.run("(({left, top}) => [left, top])(document.getElementById('view3d').getBoundingClientRect())")
    pixel = browser.run("metricTree.view3d.pixel('c')")
    browser.click((frame[0] + pixel[0], frame[1] + pixel[1]))
    browser.wait("document.getElementById('view3d-said').textContent.includes('too small by half')")
    browser.run("document.querySelectorAll('#view3d-boxes button')[0].click()")
    browser.wait("document.getElementById('view3d-said').textContent.startsWith('chair a')")
    browser.run("document.getElementById('view3d-above').click()")
    drop_file(browser, "broken.glb", glb_bytes(hand_view())[:900])
    browser.wait("document.getElementById('message').textContent.includes('broken.glb: a chunk is longer')")
    assert browser.run("problems") == []


def test_the_sliders_of_a_region_and_a_year(browser: Browser, tmp_path: Path) -> None:
    """On the shipped car: every step has sizes, the region moves them, and the screen reader hears the year."""
    (tmp_path / "nodes").mkdir()
    (tmp_path / "assets").mkdir()
    catalogue = ReleaseCatalogue([metric_tree.open()])
    for address in ("nodes/car.n.01.html", "assets/page.js", "assets/style.css"):
        made = render(catalogue, address)
        assert made is not None
        (tmp_path / address).write_bytes(made)
    see(browser, (tmp_path / "nodes" / "car.n.01.html").as_uri())
    median = "Number(document.querySelector('#context-rows data').value)"
    years = int(browser.run("document.getElementById('year').max"))
    assert years >= 3
    seen = set()
    for step in range(years + 1):
        browser.run(f"document.getElementById('year').value = {step}")
        browser.run("document.getElementById('year').dispatchEvent(new Event('input'))")
        shown = browser.run("document.getElementById('year-shown').textContent")
        assert browser.run("document.getElementById('year').getAttribute('aria-valuetext')") == shown
        seen.add((shown, browser.run(median)))
    assert len({year for year, _ in seen}) == years + 1
    assert len({size for _, size in seen}) > 1
    before = browser.run(median)
    moved = []
    for region in browser.run("[...document.getElementById('region').options].map((one) => one.value)"):
        browser.run(f"document.getElementById('region').value = {json.dumps(region)}")
        browser.run("document.getElementById('region').dispatchEvent(new Event('change'))")
        moved.append(browser.run(median) != before)
    assert moved[0] is False  # the world, as before
    assert any(moved)


def test_a_plain_file_server_is_enough(site: Path, browser: Browser) -> None:
    """Search, open, compare by a link, scale; every page is painted, and no other host is requested."""
    asked: list[str] = []

    class Files(SimpleHTTPRequestHandler):
        def log_message(self, _form: str, *args: object) -> None:
            asked.append(str(args[0]))

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Files, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://127.0.0.1:{server.server_address[1]}"
        for page in (
            "index.html",
            "nodes/swivel_chair.n.01.html",
            "compare.html?nodes=rat.n.01,mt-bar_stool",
        ):
            see(browser, f"{base}/{page}")
            browser.wait("performance.getEntriesByName('first-contentful-paint').length")
        assert browser.run("[...document.querySelectorAll('#compared tbody th')].map(cell => cell.textContent)") == [
            "rat",
            "bar stool",
        ]
        see(browser, f"{base}/scale.html")
        browser.run("document.getElementById('example').click()")
        browser.wait("!document.getElementById('result').hidden")
        hosts = "[...new Set(performance.getEntriesByType('resource').map((one) => new URL(one.name).host))]"
        assert browser.run(hosts) == [base.removeprefix("http://")]
        server.shutdown()
    assert any("names.js" in line for line in asked) is False  # the index waits for a keystroke
    assert not any(" 404 " in line for line in asked)
    assert browser.run("problems") == []
