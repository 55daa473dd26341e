"""Weights of the explorer's pages, the time of an answer of its search, and ten questions of a new user.

    python -m benchmarks.explorer_pages [SITE]

Chromium without a screen asks a server of the shipped release. SITE is a folder of `metric-tree site`; with it every
page of a category is weighed. Each question is asked as a person does: the home page, a text in the box, Enter.
"""

from __future__ import annotations

import argparse
import gzip
import json
import statistics
import tempfile
import time
from pathlib import Path

import metric_tree
from tests.explorer.conftest import running
from tests.synthetic.browser import Browser

#: What a new user asks, and what he types.
QUESTIONS = {
    "How high is an office chair, and who says so?": "office chair",
    "How tall is a door?": "door",
    "Is the mouse of COCO the animal?": "coco mouse",
    "How long is a car?": "car",
    "How high is a mug?": "mug",
    "How large is a refrigerator?": "refridgerator",
    "How long is a bicycle?": "bicycle",
    "How high is a kitchen counter?": "kitchen counter",
    "How large is an acoustic guitar?": "acoustic guitar",
    "What of the Walters museum is in it?": "walters",
}

#: Texts of which the answer is timed, right and misspelt.
TEXTS = ("chair", "swivle chair", "cofee table", "coco mouse", "refridgerator", "dor", "walters", "bicycl", "xylophon")


def main() -> None:
    """Print the weights, the times and the answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", metavar="SITE", nargs="?", type=Path, help="a folder of `metric-tree site`")
    arguments = parser.parse_args()
    if arguments.site is not None:
        print_weights(arguments.site)
    with (
        running([metric_tree.open()]) as base,
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        Browser(Path(profile)) as browser,
    ):
        browser.call("Page.enable")
        for question, text in QUESTIONS.items():
            print(f"- {question} {answer_of(browser, base, text)}")
        browser.open(f"{base}/index.html")
        browser.run("document.getElementById('search').focus()")
        browser.type("a")
        browser.wait("window.metricTree.search")
        times = {text: search_ms(browser, text) for text in TEXTS}
        print("search, ms: " + ", ".join(f"{text} {ms:.1f}" for text, ms in times.items()))


def print_weights(site: Path) -> None:
    """Compressed kB of the pages of categories and of the index of names, and MB of the whole site."""
    pages = [len(gzip.compress(page.read_bytes(), 6)) / 1000 for page in (site / "nodes").glob("*.html")]
    index = len(gzip.compress((site / "assets" / "names.js").read_bytes(), 6)) / 1000
    whole = [path.stat().st_size for path in site.rglob("*") if path.is_file()]
    print(f"{len(pages):,} pages of categories: median {statistics.median(pages):.1f} kB, most {max(pages):.1f} kB")
    print(f"index of names {index:.0f} kB; the site {sum(whole) / 1e6:.0f} MB in {len(whole):,} files")


def answer_of(browser: Browser, base: str, text: str) -> str:
    """Seconds to the page, and its sentence."""
    started = time.perf_counter()
    browser.open(f"{base}/index.html")
    browser.run("document.getElementById('search').focus()")
    browser.type(text)
    browser.wait("document.querySelector('#hit-0')")
    browser.press("Enter")
    browser.wait("/\\/(nodes|sources)\\//.test(location.pathname) && document.readyState == 'complete'")
    said = browser.run("document.querySelector('.sentence').textContent")
    return f"({time.perf_counter() - started:.1f} s) {said}"


def search_ms(browser: Browser, text: str) -> float:
    """Milliseconds of an answer in the browser, the mean of five."""
    asked = f"for (let k = 0; k < 5; k++) metricTree.search({json.dumps(text)})"
    return float(
        browser.run(f"(() => {{ const t = performance.now(); {asked}; return (performance.now() - t) / 5; }})()")
    )


if __name__ == "__main__":
    main()
