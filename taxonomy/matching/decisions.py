"""Reviewers' decisions: two per subject, the second without sight of the first, a third where they disagree.

A named person's word outranks those of programs. All readings that ship are by programs, and say so.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from metric_base.errors import InputError, expect, in_file
from metric_base.files import whole_file
from metric_base.folders import is_checkout, taxonomy_directory, user_data_folder
from metric_base.records import json_lines

#: What a decision is about: the concept of a source's words, or the parent of an inserted category.
What = Literal["match", "insertion"]

#: The source of a decision that holds for all sources.
EVERY_SOURCE = "*"

#: How a file writes that there is no category: the words name no item of one size.
NONE = "none"

#: How a file writes that a reviewer takes an earlier word back: the subject then waits for that reviewer again.
WITHDRAWN = "withdrawn"

#: Reviewers whose agreement settles a subject.
_REVIEWERS = 2

#: How a program names itself as a reviewer; whoever else signs is a person.
PROGRAM = "program:"


class BadDecision(InputError):
    """A decision that cannot be read or recorded: the message names file, line, field, expected and found."""


class Decision(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One reviewer's word on one subject.

    `subject` is `source: folded words` (or `*: words` for all sources) of a match, the `mt:` id of an insertion.
    `decision` is a concept, or None for `none`. `reviewer` names a person, or a program for what it is. `blind` is
    false where the reviewer knew another's answer, as in an amendment; such decisions count, but not for agreement.
    """

    what: What
    subject: str
    decision: str | None
    reviewer: str
    when: str
    why: str = ""
    blind: bool = True

    def __post_init__(self) -> None:
        expect(bool(self.subject.strip()), "subject", "what the decision is about", self.subject)
        expect(bool(self.reviewer.strip()), "reviewer", "a name", self.reviewer)
        matched = self.what != "match" or ": " in self.subject
        expect(matched, "subject", "<source>: <words>, or *: <words>", self.subject)
        if self.decision == NONE:
            msgspec.structs.force_setattr(self, "decision", None)

    @property
    def is_programs(self) -> bool:
        """Return True if a program read it: its word yields to that of a named person."""
        return self.reviewer.startswith(PROGRAM)

    def line(self) -> str:
        """The decision as one JSON line."""
        record = msgspec.to_builtins(self) | {"decision": self.decision or NONE}
        if self.blind:
            del record["blind"]
        return json.dumps(record, ensure_ascii=False)


@dataclass(frozen=True, slots=True)
class Agreement:
    """How two reviewers agree: `share` of the `n` subjects both read, and Cohen's `kappa`."""

    n: int
    share: float
    kappa: float


def decisions(folder: Path | None = None) -> list[Decision]:
    """All decisions of a folder's `*.jsonl` files, by file name and line.

    Raises
    ------
    BadDecision
        A line is not a decision.
    """
    folders = decision_folders() if folder is None else [folder]
    files = [file for one in folders for file in sorted(one.glob("*.jsonl"))]
    return [decision for file in files for _, decision in json_lines(file, Decision, BadDecision)]


def rulings(given: Iterable[Decision]) -> dict[tuple[str, str], Decision]:
    """What is settled, by (source, words) of matches: the decision that two reviewers share."""
    settled = {}
    for (what, subject), by_reviewer in _by_subject(given).items():
        decision = _majority_decision(list(by_reviewer.values()))
        if what == "match" and decision is not None:
            source, _, words = subject.partition(": ")
            settled[source, words] = decision
    return settled


def standing(given: Iterable[Decision]) -> list[Decision]:
    """The last word of each reviewer on each subject, without those that were withdrawn."""
    return [decision for by_reviewer in _by_subject(given).values() for decision in by_reviewer.values()]


def waiting(given: Iterable[Decision]) -> list[tuple[str, str]]:
    """(what, subject) of all that fewer than two reviewers have read, or that two read differently and no third has.

    A subject whose decisions were all withdrawn waits, too: its items are unsettled again.
    """
    given = list(given)
    subjects = dict.fromkeys((decision.what, decision.subject) for decision in given)
    read = _by_subject(given)
    return [key for key in subjects if _majority_decision(list(read.get(key, {}).values())) is None]


def disagreements(given: Iterable[Decision]) -> list[tuple[Decision, Decision]]:
    """First and second blind reading of every subject on which they differ, settled by a third or not."""
    by_subject = _by_subject(d for d in given if d.blind)
    pairs = [list(by_reviewer.values())[:_REVIEWERS] for by_reviewer in by_subject.values()]
    return [(first, second) for first, second in (p for p in pairs if len(p) == _REVIEWERS) if _differ(first, second)]


def agreement(given: Iterable[Decision], what: What | None = None) -> Agreement:
    """Cohen's kappa of first and second blind readings: (p_o - p_e) / (1 - p_e), p_e from each one's own shares."""
    by_subject = _by_subject(d for d in given if d.blind and what in (None, d.what))
    pairs = [list(r.values())[:_REVIEWERS] for r in by_subject.values() if len(r) >= _REVIEWERS]
    if not pairs:
        return Agreement(0, float("nan"), float("nan"))
    n = len(pairs)
    observed = sum(not _differ(first, second) for first, second in pairs) / n
    first_shares, second_shares = (Counter(pair[i].decision for pair in pairs) for i in (0, 1))
    expected = sum(first_shares[d] * second_shares[d] for d in first_shares) / n**2
    return Agreement(n, observed, 1.0 if expected == 1 else (observed - expected) / (1 - expected))


def record_decision(decision: Decision, file: Path, *, amend: bool = False) -> None:
    """Add a decision to a file, which is whole at every moment: written beside it, then renamed.

    Parameters
    ----------
    decision : the reviewer's word; with `amend`, one that replaces an earlier word of the same reviewer.
    file : a `*.jsonl` file; the other ones of its folder are read for earlier words.
    amend : whether an earlier word is replaced, or taken back where the decision is `withdrawn`.

    Raises
    ------
    BadDecision
        The reviewer has decided the subject already, or with `amend` has not.
    """
    earlier = [one for one in decisions(file.parent) if _identity(one) == _identity(decision)]
    stands = bool(earlier) and earlier[-1].decision != WITHDRAWN
    with in_file(file, BadDecision):
        expect(amend or not stands, "subject", f"one that {decision.reviewer} has not decided", decision.subject)
        expect(stands or not amend, "subject", f"one that {decision.reviewer} has decided", decision.subject)
    before = file.read_text(encoding="utf-8").removesuffix("\n").split("\n") if file.is_file() else []
    file.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(file) as part:
        part.write_text("\n".join([*before, decision.line(), ""]), encoding="utf-8")


@cache
def default_rulings() -> Mapping[tuple[str, str], Decision]:
    """The settled matches of this checkout."""
    return rulings(decisions())


def decision_folders() -> list[Path]:
    """Where decisions are read by default: the project's, those of the user's data folder, those of `./decisions`."""
    folders = [taxonomy_directory() / "decisions", user_data_folder() / "decisions", Path("decisions")]
    return list({folder.resolve(): folder for folder in folders if folder.is_dir()}.values())


def record_folder() -> Path:
    """Where a decision is recorded by default, never in an installation.

    `./decisions` where there is one, else the project's own in a checkout, else the user's data folder.
    """
    if Path("decisions").is_dir():
        return Path("decisions")
    home = taxonomy_directory() if is_checkout() else user_data_folder()
    return home / "decisions"


def _identity(decision: Decision) -> tuple[str, str, str]:
    return decision.what, decision.subject, decision.reviewer


def _by_subject(given: Iterable[Decision]) -> dict[tuple[str, str], dict[str, Decision]]:
    """Decisions by subject, then by reviewer in order; a later word replaces an earlier one, or takes it back."""
    grouped: defaultdict[tuple[str, str], dict[str, Decision]] = defaultdict(dict)
    for decision in given:
        words = grouped[decision.what, decision.subject]
        if decision.decision == WITHDRAWN:
            words.pop(decision.reviewer, None)
        else:
            words[decision.reviewer] = decision
    return {key: words for key, words in grouped.items() if words}


def _majority_decision(read: Sequence[Decision]) -> Decision | None:
    """The decision that at least two reviewers share, or None; where persons have read it, programs have no vote.

    One person's word stands where only programs have read the subject beside; persons who differ need a majority.
    """
    persons = [decision for decision in read if not decision.is_programs]
    if len(persons) == 1 < len(read):
        return persons[0]
    read = persons or read
    shares = Counter(decision.decision for decision in read)
    return next((decision for decision in read if shares[decision.decision] >= _REVIEWERS), None)


def _differ(first: Decision, second: Decision) -> bool:
    return first.decision != second.decision
