"""The study's page: one HTML file with its pictures inside, which works offline and saves answers to a file."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["ANSWERS_SCHEMA", "STEPS", "study_page"]

#: The paper's changes of size, in per cent.
STEPS = (-30, -20, -15, -10, -5, 0, 5, 10, 15, 20, 30)
ANSWERS_SCHEMA = "metric-tree/study-answers/1"
_TEMPLATE = Path(__file__).with_name("page.html")
JPEG_QUALITY = 92


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
