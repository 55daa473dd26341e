"""Answers of the study, as the page saves them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from insertion.study.page import ANSWERS_SCHEMA
from metric_base.faults import InputFault

__all__ = ["ANSWERS", "Answer", "read_answers"]

ANSWERS = ("too small", "right", "too large")
#: A size changes by less than this factor either way; anything else is no answer of this study.
_STEP_RANGE = (-90.0, 900.0)


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
    files = sorted(path.glob("*.json")) if path.is_dir() else [path]
    answers = [answer for file in files for answer in _answers_of(file)]
    if not answers:
        raise InputFault(f"{path}: answers: expected at least one; found none")
    return answers


def _answers_of(file: Path) -> list[Answer]:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as fault:
        raise InputFault(f"{file}: expected JSON; found {fault}") from None
    if not isinstance(document, dict) or document.get("schema") != ANSWERS_SCHEMA:
        schema = document.get("schema") if isinstance(document, dict) else type(document).__name__
        raise InputFault(f"{file}: schema: expected {ANSWERS_SCHEMA}; found {schema!r}")
    rows = document.get("answers")
    if not isinstance(rows, list):
        raise InputFault(f"{file}: answers: expected a list; found {type(rows).__name__}")
    participant = str(document.get("participant"))
    return [_answer(file, number, participant, row) for number, row in enumerate(rows)]


def _answer(file: Path, number: int, participant: str, row: Any) -> Answer:
    step = row.get("step") if isinstance(row, dict) else None
    words = row.get("answer") if isinstance(row, dict) else None
    if isinstance(step, bool) or not isinstance(step, int | float) or not _STEP_RANGE[0] <= step <= _STEP_RANGE[1]:
        raise InputFault(f"{file}: answers[{number}].step: expected a change in per cent; found {step!r}")
    if words not in ANSWERS:
        raise InputFault(f"{file}: answers[{number}].answer: expected one of {', '.join(ANSWERS)}; found {words!r}")
    return Answer(participant, float(step), str(words))
