"""Decisions of reviewers: two blind ones per subject, and a third if they disagree.

Decisions of persons take precedence over those of programs. All decisions that ship are by programs and marked as such.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from metric_base.errors import InputError, expect, in_file
from metric_base.files import write_whole
from metric_base.folders import code_folder, data_folder, taxonomy_directory, user_data_folder
from metric_base.records import json_lines

#: Subject of a decision: the concept of words of a source, or the parent of an inserted category.
What = Literal["match", "insertion"]

#: Source of a decision for all sources.
EVERY_SOURCE = "*"

#: Decision in files: the words are not the name of items of one size.
NONE = "none"

#: Decision in files: a reviewer withdraws an earlier decision, and the subject is open again.
WITHDRAWN = "withdrawn"

#: Number of reviewers who must agree.
MIN_REVIEWERS = 2

#: Prefix of the names of programs; all other reviewers are persons.
PROGRAM = "program:"


class BadDecision(InputError):
    """A decision is invalid or cannot be recorded."""


class Decision(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Decision of a reviewer on a subject."""

    what: What
    subject: str  #: `<source>: <folded words>` or `*: <words>` of a match, the `mt:` id of an insertion.
    decision: str | None  #: Concept, or None for `none`.
    reviewer: str  #: Person, or program with its prefix.
    when: str
    why: str = ""
    blind: bool = True  #: False if the reviewer knew another decision; then it is not part of the agreement.

    def __post_init__(self) -> None:
        expect(bool(self.subject.strip()), "subject", "the subject of the decision", self.subject)
        expect(bool(self.reviewer.strip()), "reviewer", "a name", self.reviewer)
        matched = self.what != "match" or ": " in self.subject
        expect(matched, "subject", "<source>: <words>, or *: <words>", self.subject)
        if self.decision == NONE:
            msgspec.structs.force_setattr(self, "decision", None)

    @property
    def is_programs(self) -> bool:
        """Return True if the reviewer is a program."""
        return self.reviewer.startswith(PROGRAM)

    def line(self) -> str:
        """Return the JSON line of the decision."""
        record = msgspec.to_builtins(self) | {"decision": self.decision or NONE}
        if self.blind:
            del record["blind"]
        return json.dumps(record, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of two reviewers."""

    n: int  #: Number of subjects with two decisions.
    share: float  #: Fraction of equal decisions.
    kappa: float  #: Cohen's kappa.


def decisions(folder: Path | None = None) -> list[Decision]:
    """Return all decisions of the `*.jsonl` files of a folder, by file name and line.

    Raises
    ------
    BadDecision
        A line is not a decision.
    """
    folders = decision_folders() if folder is None else [folder]
    files = [file for one in folders for file in sorted(one.glob("*.jsonl"))]
    return [decision for file in files for _, decision in json_lines(file, Decision, BadDecision)]


def rulings(given: Iterable[Decision]) -> dict[tuple[str, str], Decision]:
    """Return the decisions of matches on which two reviewers agree, by source and words."""
    settled = {}
    for (what, subject), by_reviewer in _by_subject(given).items():
        decision = _majority_decision(list(by_reviewer.values()))
        if what == "match" and decision is not None:
            source, _, words = subject.partition(": ")
            settled[source, words] = decision
    return settled


def standing(given: Iterable[Decision]) -> list[Decision]:
    """Return the last decision of each reviewer on each subject, without withdrawn ones."""
    return [decision for by_reviewer in _by_subject(given).values() for decision in by_reviewer.values()]


def waiting(given: Iterable[Decision]) -> list[tuple[str, str]]:
    """Return the subjects without a decision of two reviewers who agree, as (what, subject).

    These include subjects whose decisions were all withdrawn.
    """
    given = list(given)
    subjects = dict.fromkeys((decision.what, decision.subject) for decision in given)
    read = _by_subject(given)
    return [key for key in subjects if _majority_decision(list(read.get(key, {}).values())) is None]


def disagreements(given: Iterable[Decision]) -> list[tuple[Decision, Decision]]:
    """Return the first two blind decisions of each subject on which they differ, even if a third one settles it."""
    by_subject = _by_subject(d for d in given if d.blind)
    pairs = [list(by_reviewer.values())[:MIN_REVIEWERS] for by_reviewer in by_subject.values()]
    complete = [(pair[0], pair[1]) for pair in pairs if len(pair) == MIN_REVIEWERS]
    return [(first, second) for first, second in complete if first.decision != second.decision]


def agreement(given: Iterable[Decision], what: What | None = None) -> Agreement:
    """Return the agreement of the first two blind decisions of each subject.

    Cohen's kappa is (p_o - p_e) / (1 - p_e), with the observed agreement p_o and the agreement p_e that the fractions
    of the decisions of each reviewer imply (Cohen 1960, A coefficient of agreement for nominal scales).
    """
    by_subject = _by_subject(d for d in given if d.blind and what in (None, d.what))
    pairs = [list(r.values())[:MIN_REVIEWERS] for r in by_subject.values() if len(r) >= MIN_REVIEWERS]
    if not pairs:
        return Agreement(0, float("nan"), float("nan"))
    n = len(pairs)
    observed = sum(first.decision == second.decision for first, second in pairs) / n
    first_shares, second_shares = (Counter(pair[i].decision for pair in pairs) for i in (0, 1))
    expected = sum(first_shares[d] * second_shares[d] for d in first_shares) / n**2
    return Agreement(n, observed, 1.0 if expected == 1 else (observed - expected) / (1 - expected))


def record_decision(decision: Decision, file: Path, *, amend: bool = False) -> None:
    """Add a decision to a file, which is replaced as a whole.

    Parameters
    ----------
    decision : Decision
    file : Path
        A `*.jsonl` file; all such files of its folder are searched for earlier decisions.
    amend : bool
        Replace the earlier decision of the reviewer, or withdraw it if the decision is `withdrawn`.

    Raises
    ------
    BadDecision
        The reviewer has already decided on the subject, or has not and `amend` is set.
    """
    key = (decision.what, decision.subject, decision.reviewer)
    earlier = [other for other in decisions(file.parent) if (other.what, other.subject, other.reviewer) == key]
    stands = bool(earlier) and earlier[-1].decision != WITHDRAWN
    with in_file(file, BadDecision):
        expect(amend or not stands, "subject", f"one that {decision.reviewer} has not decided", decision.subject)
        expect(stands or not amend, "subject", f"one that {decision.reviewer} has decided", decision.subject)
    before = file.read_text(encoding="utf-8").removesuffix("\n").split("\n") if file.is_file() else []
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, "\n".join([*before, decision.line(), ""]))


def decision_folders() -> list[Path]:
    """Return the default folders of decisions: of the project, of the data folder of the user, and `./decisions`."""
    folders = [taxonomy_directory() / "decisions", user_data_folder() / "decisions", Path("decisions")]
    return list({folder.resolve(): folder for folder in folders if folder.is_dir()}.values())


def record_folder() -> Path:
    """Return the default folder of new decisions.

    It is `./decisions` if it exists, else that of the project in a checkout, else that of the data folder of the user.
    """
    if Path("decisions").is_dir():
        return Path("decisions")
    return (taxonomy_directory() if data_folder() == code_folder() / "data" else user_data_folder()) / "decisions"


def _by_subject(given: Iterable[Decision]) -> dict[tuple[str, str], dict[str, Decision]]:
    """Group decisions by subject, then by reviewer in order; later ones replace or withdraw earlier ones."""
    grouped: defaultdict[tuple[str, str], dict[str, Decision]] = defaultdict(dict)
    for decision in given:
        words = grouped[decision.what, decision.subject]
        if decision.decision == WITHDRAWN:
            words.pop(decision.reviewer, None)
        else:
            words[decision.reviewer] = decision
    return {key: words for key, words in grouped.items() if words}


def _majority_decision(read: Sequence[Decision]) -> Decision | None:
    """Return the decision on which at least two reviewers agree, or None.

    Programs have no vote if persons have decided; one person outvotes any number of programs.
    """
    persons = [decision for decision in read if not decision.is_programs]
    if len(persons) == 1 < len(read):
        return persons[0]
    read = persons or read
    counts = Counter(decision.decision for decision in read)
    return next((decision for decision in read if counts[decision.decision] >= MIN_REVIEWERS), None)
