"""Answers of the study, as the page saves them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec

from insertion.study.page import ANSWERS_SCHEMA
from metric_base.faults import InputFault, in_file
from metric_base.input_files import folder_entries, read_bytes
from metric_base.schema import expect, json_record

__all__ = ["ANSWERS", "Answer", "read_answers"]

Judgement = Literal["too small", "right", "too large"]
ANSWERS: tuple[str, ...] = get_args(Judgement)
#: Most steps times participants: the page has 11 steps.
MAX_CELLS = 1_000_000
#: Largest file of answers; the page's own has some 10 kB.
MAX_BYTES = 1 << 24


class _Row(msgspec.Struct):
    """One answer of the page; a size changes by less than a factor of ten either way."""

    step: Annotated[float, msgspec.Meta(ge=-90, le=900)]
    answer: Judgement


class _Answers(msgspec.Struct):
    """The file that the page saves."""

    schema: str
    answers: list[_Row] = []
    participant: str | None = None

    def __post_init__(self) -> None:
        expect(self.schema == ANSWERS_SCHEMA, "schema", ANSWERS_SCHEMA, self.schema)


@dataclass(frozen=True, slots=True)
class Answer:
    """One judgement: who, the change of size in per cent, and the words."""

    participant: str
    step: float
    answer: str


def read_answers(path: Path) -> list[Answer]:
    """All answers of a file, or of the JSON files in a folder.

    Raises
    ------
    InputFault
        No file, a file of another kind, or a value that the page does not write.
    """
    if not path.exists():
        raise InputFault(f"{path}: expected a file of answers or a folder of them; found none")
    files = [one for one in folder_entries(path) if one.suffix == ".json"] if path.is_dir() else [path]
    answers = [answer for file in files for answer in _answers_of(file)]
    if not answers:
        raise InputFault(f"{path}: answers: expected at least one; found none")
    steps, people = (len({getattr(answer, field) for answer in answers}) for field in ("step", "participant"))
    if steps * people > MAX_CELLS:
        raise InputFault.at(path, "answers", f"at most {MAX_CELLS:,} steps times participants", steps * people)
    return answers


def _answers_of(file: Path) -> list[Answer]:
    with in_file(file):
        document = json_record(read_bytes(file, limit=MAX_BYTES), _Answers)
    return [Answer(str(document.participant), row.step, row.answer) for row in document.answers]
