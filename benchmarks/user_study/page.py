"""The study's page: one HTML file with its pictures inside, which works offline and saves answers to a file.

How many people a study needs: the intervals to expect with a curve as flat as the paper's.
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

#: The paper's changes of size, in per cent.
STEPS = (-30, -20, -15, -10, -5, 0, 5, 10, 15, 20, 30)
_TEMPLATE = Path(__file__).with_name("page.html")
JPEG_QUALITY = 92
#: At most 0.65 say "right", at -5 %, as in the paper; an error of a quarter in perceived size makes it so.
FLAT = Observer(bias=float(-np.log(0.95)), sigma=0.25, criterion=0.234)
#: Standard deviation of people's own biases, in log size: a guess, on the careful side.
BIAS_SPREAD = 0.05
#: 95 % intervals.
_Z = 1.959964
#: Numbers of people that the plan names; the paper asked 27.
PEOPLE = (10, 27, 100)


def study_page(pictures: Mapping[int, NDArray[np.uint8]], title: str, name: str, repeats: int) -> str:
    """The page. pictures : (h, w, 3) RGB by step in per cent; name : what the inserted object is called."""
    shown = [{"step": step, "data": _data(picture)} for step, picture in sorted(pictures.items())]
    study = {
        "schema": ANSWERS_SCHEMA,
        "title": title,
        "object": name,
        "repeats": repeats,
        "pictures": shown,
        "study": hashlib.sha256(json.dumps(shown).encode()).hexdigest()[:16],
    }
    text = json.dumps(study).replace("<", "\\u003c")  # "</script>" and "<!--" mean something in a page
    return _TEMPLATE.read_text(encoding="utf-8").replace("/*STUDY*/null", text)


def _data(picture: NDArray[np.uint8]) -> str:
    """The picture (h, w, 3) RGB as a data address of a JPEG."""
    import cv2

    ok, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert ok  # a picture in memory always encodes
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def expected_intervals(people: int, repeats: int, observer: Observer = FLAT) -> tuple[float, float]:
    """Half the widths of the 95 % intervals of the peak and of the just-noticeable step, in per cent.

    By the Fisher information of the answers; every size is shown `repeats` times to each person.
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
    """What to expect, in a line for each number of people."""
    lines = [f"with a curve as flat as the paper's (at most 0.65 say right), {11 * repeats} pictures each:"]
    for people in PEOPLE:
        peak, step = expected_intervals(people, repeats)
        lines.append(
            f"  {people:3d} people: the peak within {peak:.0f} %, the just-noticeable step within {step:.0f} %"
        )
    return "\n".join(lines)


def _slope(values: FloatArray, row: int, steps: FloatArray) -> FloatArray:
    """(n, 3) change of the shares at steps (n,) with one of the observer's numbers, values (3,)."""
    small = 1e-4
    ends = [values.copy(), values.copy()]
    ends[0][row] -= small
    ends[1][row] += small
    low, high = (Observer(*end.tolist()).shares(steps) for end in ends)
    return np.asarray((high - low) / (2 * small))
