"""Write the page of the study: an HTML file with embedded images that works offline and saves the responses to a file.

`expected_intervals` predicts the accuracy of a study from its number of participants.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.user_study.answers import ANSWERS_SCHEMA
from benchmarks.user_study.curve import JUST_NOTICEABLE, Observer
from metric_base.arrays import FloatArray

#: Changes of size in the paper, in per cent.
STEPS = (-30, -20, -15, -10, -5, 0, 5, 10, 15, 20, 30)
_TEMPLATE = Path(__file__).with_name("page.html")
JPEG_QUALITY = 92
#: Observer with the paper's peak: 65 % "right" at -5 %, which corresponds to an error of 25 % in the perceived size.
FLAT = Observer(bias=float(-np.log(0.95)), sigma=0.25, criterion=0.234)
#: Standard deviation of the participants' biases in log size (a conservative guess).
BIAS_SPREAD = 0.05
#: Half width of the central 95 % interval of a normal distribution, in standard deviations.
_Z = 1.959964
#: Numbers of participants in the plan; the paper had 27.
PEOPLE = (10, 27, 100)


def study_page(images: Mapping[int, NDArray[np.uint8]], title: str, name: str, repeats: int) -> str:
    """Return the HTML of the page.

    images : (h, w, 3) RGB by step in per cent.
    name : name of the inserted object.
    """
    entries = [{"step": step, "data": _data_url(image)} for step, image in sorted(images.items())]
    study = {
        "schema": ANSWERS_SCHEMA,
        "title": title,
        "object": name,
        "repeats": repeats,
        "pictures": entries,
        "study": hashlib.sha256(json.dumps(entries).encode()).hexdigest()[:16],
    }
    text = json.dumps(study).replace("<", "\\u003c")  # "</script>" and "<!--" would be parsed as HTML
    return _TEMPLATE.read_text(encoding="utf-8").replace("/*STUDY*/null", text)


def _data_url(image: NDArray[np.uint8]) -> str:
    """Return the image (h, w, 3) RGB as the data URL of a JPEG file."""
    import cv2

    ok, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert ok  # encoding in memory does not fail
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def expected_intervals(people: int, repeats: int, observer: Observer = FLAT) -> tuple[float, float]:
    """Return half the widths of the 95 % intervals of the peak and of the just-noticeable step, in per cent.

    They follow from the Fisher information of the responses if each participant sees every size `repeats` times.
    """
    steps = np.array(STEPS, dtype=float)
    values = np.array([observer.bias, observer.sigma, observer.criterion])
    slopes = np.stack([_slope(values, row, steps) for row in range(3)])
    shares = observer.shares(steps)
    information = repeats * np.einsum("ank,bnk,nk->ab", slopes, slopes, 1 / shares)
    spread = np.linalg.inv(information) / people
    peak = np.sqrt(spread[0, 0] + BIAS_SPREAD**2 / people)
    noticeable = JUST_NOTICEABLE * np.sqrt(spread[1, 1])
    return 100 * _Z * float(peak), 100 * _Z * float(noticeable)


def plan_text(repeats: int) -> str:
    """Return the expected intervals as text, one line for each number of participants."""
    lines = [f"with a curve as flat as the paper's (at most 0.65 say right), {11 * repeats} images each:"]
    for people in PEOPLE:
        peak, step = expected_intervals(people, repeats)
        lines.append(
            f"  {people:3d} people: the peak within {peak:.0f} %, the just-noticeable step within {step:.0f} %"
        )
    return "\n".join(lines)


def _slope(values: FloatArray, row: int, steps: FloatArray) -> FloatArray:
    """Return the derivative (n, 3) of the probabilities at steps (n,) by one of the observer's parameters (3,)."""
    small = 1e-4
    ends = [values.copy(), values.copy()]
    ends[0][row] -= small
    ends[1][row] += small
    low, high = (Observer(*end.tolist()).shares(steps) for end in ends)
    return np.asarray((high - low) / (2 * small))
