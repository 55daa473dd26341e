"""Names that changed are read in their old form for one release."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.user_study.answers import ANSWERS_SCHEMA, read_answers
from benchmarks.user_study.make import page_parser
from metric_base.errors import InputError


def test_the_object_of_saved_answers(tmp_path: Path) -> None:
    """Answers about one object, saved by an old page and a new one, go together; about two they do not."""
    record = {"schema": ANSWERS_SCHEMA, "study": "s", "answers": [{"step": 5, "answer": "right"}]}
    for name, field, value in (("a", "thing", "chair"), ("b", "object", "chair")):
        (tmp_path / f"{name}.json").write_text(json.dumps({**record, "participant": name, field: value}))
    assert len(read_answers(tmp_path)) == 2
    (tmp_path / "c.json").write_text(json.dumps({**record, "participant": "c", "thing": "table"}))
    with pytest.raises(InputError, match="the answers of one page"):
        read_answers(tmp_path)


def test_options() -> None:
    page = ["scene", "--model", "m.glb", "--out", "study.html"]
    assert page_parser().parse_args([*page, "--thing", "chair"]).object == "chair"
    assert page_parser().parse_args(page).object == "object"
