"""Names that changed are read in their old form for one release."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from benchmarks.user_study.answers import ANSWERS_SCHEMA, read_answers
from benchmarks.user_study.make import page_parser
from crawler.imports.declaration import Rule
from metric_base.errors import InputError
from metric_cli.subcommands.data.build import add_arguments
from metric_tree.cutouts.guided import guides
from taxonomy.matching.readings import Reading


def test_the_reason_of_a_declaration_and_the_domain_of_a_reading() -> None:
    with pytest.warns(DeprecationWarning, match="set_of_objects"):
        assert Rule(column="a", outcome="set_of_things", above=1).outcome == "set_of_objects"
    with pytest.warns(DeprecationWarning, match="'objects'"):
        assert Reading(domain="things").domain == "objects"


def test_the_strokes_of_a_guide(tmp_path: Path) -> None:
    line = {"picture": "0" * 64, "box": [1, 2, 30, 40], "reviewer": "a", "thing": [[[3, 4], [5, 6]]]}
    (tmp_path / "guides.jsonl").write_text(json.dumps(line) + "\n", encoding="utf-8")
    with pytest.warns(DeprecationWarning, match="'object'"):
        (guide,) = guides(tmp_path / "guides.jsonl").values()
    assert guide.object == (((3, 4), (5, 6)),)


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
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = ["raw", "--out", "release", "--own-use", "one", "--include-withheld", "two"]
    assert parser.parse_args(words).private == ["one", "two"]
    page = ["scene", "--model", "m.glb", "--out", "study.html"]
    assert page_parser().parse_args([*page, "--thing", "chair"]).object == "chair"
    assert page_parser().parse_args(page).object == "object"
