"""Read the responses that the page of the study saves."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec

from metric_base.errors import InputError, expect, in_file
from metric_base.input_files import folder_entries, read_bytes
from metric_base.records import json_record

#: Schema of a file of responses.
ANSWERS_SCHEMA = "metric-tree/study-answers/1"
Judgement = Literal["too small", "right", "too large"]
ANSWERS: tuple[str, ...] = get_args(Judgement)
#: Maximum number of steps times participants; limits the memory of the tables. The page has 11 steps.
MAX_CELLS = 1_000_000
#: Maximum size of a file of responses; the page saves about 10 kB.
MAX_BYTES = 1 << 24


class _AnswerRow(msgspec.Struct):
    """One answer of the page. Sizes change by at most a factor of ten in both directions."""

    step: Annotated[float, msgspec.Meta(ge=-90, le=900)]
    answer: Judgement


class _Answers(msgspec.Struct):
    """The file that the page saves."""

    schema: str
    answers: list[_AnswerRow] = []
    participant: str | None = None
    study: str | None = None
    object: str | None = None
    #: Former name of `object`; older pages still save it.
    thing: str | None = None

    def __post_init__(self) -> None:
        expect(self.schema == ANSWERS_SCHEMA, "schema", ANSWERS_SCHEMA, self.schema)


@dataclass(frozen=True, slots=True)
class StudyAnswer:
    """One judgement: participant, change of size in per cent, and answer."""

    participant: str
    step: float
    answer: str


def read_answers(path: Path, warnings: list[str] | None = None) -> list[StudyAnswer]:
    """Read the responses of a file, or of the JSON files in a folder without copies.

    warnings : list to which a line is appended for each copy.

    Raises
    ------
    InputError
        The file is missing, has another schema or values that the page does not write, or the folder has files of two
        studies or two different files of one participant.
    """
    if not path.exists():
        raise InputError(f"{path}: expected a file of answers or a folder of them; found none")
    files = [file for file in folder_entries(path) if file.suffix == ".json"] if path.is_dir() else [path]
    documents: dict[Path, _Answers] = {}
    for file in files:
        with in_file(file):
            documents[file] = json_record(read_bytes(file, limit=MAX_BYTES), _Answers)
    _expect_one_study(path, documents)
    answers, copies = _without_copies(documents)
    if warnings is not None:
        warnings += copies
    if not answers:
        raise InputError(f"{path}: answers: expected at least one; found none")
    steps, people = (len({getattr(answer, field) for answer in answers}) for field in ("step", "participant"))
    if steps * people > MAX_CELLS:
        raise InputError.at(path, "answers", f"at most {MAX_CELLS:,} steps times participants", steps * people)
    return answers


def _expect_one_study(path: Path, documents: Mapping[Path, _Answers]) -> None:
    """Raise an InputError if the responses are about different images, which cannot be combined in a curve."""
    by_study: dict[tuple[str | None, str | None], list[Path]] = defaultdict(list)
    for file, document in documents.items():
        by_study[document.study, document.object or document.thing].append(file)
    if len(by_study) > 1:
        named = "; ".join(f"{len(files)} about {name!r} such as {files[0].name}"
                          for (_, name), files in list(by_study.items())[:3])  # fmt: skip
        raise InputError(f"{path}: study: expected the answers of one page; found {named}")


def _without_copies(documents: Mapping[Path, _Answers]) -> tuple[list[StudyAnswer], list[str]]:
    """Return the responses without copied files, and a line for each copy."""
    first_file: dict[str, Path] = {}
    answers: list[StudyAnswer] = []
    copies = []
    for file, document in documents.items():
        participant = document.participant or file.stem
        first = first_file.setdefault(participant, file)
        if first == file:
            answers += [StudyAnswer(participant, row.step, row.answer) for row in document.answers]
        elif documents[first].answers == document.answers:
            copies.append(f"{file.name} has the same answers as {first.name} and counts once")
        else:
            raise InputError.at(file, "participant", f"one file each; {first.name} has other answers", participant)
    return answers, copies
