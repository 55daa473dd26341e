"""`metric-tree review`: what waits for a reviewer, a blind list for the second one, and the record of a decision."""

from __future__ import annotations

import argparse
import random
import re
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from metric_base.errors import InputError, in_file
from metric_base.files import whole_file
from metric_base.spelling import near_spellings
from metric_cli.parser import OutputFile, add_tree, input_path, output_folder
from metric_cli.tables import print_json, print_table

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Sequence

    from taxonomy.matching.decisions import Decision

HELP = (
    "What waits for a reviewer (list), subjects without answers (blind), record a decision, agreement, proofread sizes."
)

SCHEMA = "metric-tree/review/1"

#: Where decisions are read and recorded if no folder is named.
DEFAULT_FOLDER = "default: ./decisions if it is there, the user's own, and the project's"

#: Sources of raw items that are neither declared nor sites: our norms and ranges, and what our spider asks Wikidata.
UNDECLARED = ("norms", "judged", "wikidata")

#: A host's name, as `crawl generic` gives it to its items: `shop.example`.
HOST = re.compile(r"[a-z0-9-]+(\.[a-z0-9-]+)*\.[a-z]{2,}")

#: Nearest names of a source that a message offers.
OFFERED = 3

#: Waiting words of a source that are printed unless all are asked for.
SHOWN = 40

#: Nodes on the page for proofreading: as many as one reads in an hour.
PROOFREAD = 100

#: Order of a blind list: not the order in which the first reviewer met the subjects.
SEED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    actions = parser.add_subparsers(dest="action", metavar="list|blind|record|agreement|proof", required=True)
    waits = actions.add_parser("list", help="subjects that wait, and words of raw items that no rule settles")
    waits.add_argument(
        "raw", metavar="RAW", nargs="*", help="*.jsonl, *.jsonl.gz, or folders of them, to look for unsettled words"
    )
    waits.add_argument("--all", action="store_true", help=f"print all words, not {SHOWN}")
    blind = actions.add_parser("blind", help="what a reviewer has not read, shuffled and without any answer")
    blind.add_argument(
        "raw", metavar="RAW", nargs="*", type=input_path, help="raw items to take an example of each from"
    )
    _add_reviewer(blind, "the reviewer that will answer")
    blind.add_argument("--source", help="only subjects of this source")
    blind.add_argument("--limit", type=int, metavar="N", help="at most N subjects")
    blind.add_argument("--what", choices=["match", "insertion"], default="match", help="kind of decision")
    blind.add_argument("--seed", type=int, default=SEED, help="order of the list")
    record = actions.add_parser("record", help="record one decision")
    record.add_argument("subject", help="'SOURCE: words' or '*: words' of a match, the mt: id of an insertion")
    record.add_argument("decision", help="a synset, an mt: id, none, or withdrawn; of an insertion its parent, or none")
    record.add_argument("--amend", action="store_true", help="replace an earlier word of the same reviewer")
    _add_reviewer(record, "a person's name, or 'program: what it is'")
    record.add_argument("--what", choices=["match", "insertion"], default="match", help="kind of decision")
    record.add_argument(
        "--sources", type=input_path, metavar="DIR", help="declarations of your own: their sources exist, too"
    )
    record.add_argument("--why", default="", help="one line")
    actions.add_parser("agreement", help="Cohen's kappa of first and second readings, and where they differ")
    proof = actions.add_parser("proof", help="a page for proofreading the most used sizes that rest on little")
    proof.add_argument("--out", type=OutputFile(), metavar="FILE.html", required=True, help="the page")
    proof.add_argument("--limit", type=int, default=PROOFREAD, metavar="N", help="nodes on it (default: %(default)s)")
    add_tree(proof)
    for action in actions.choices.values():
        kind = output_folder if action is record else input_path
        action.add_argument("--folder", type=kind, metavar="DIR", help=f"folder of the decisions ({DEFAULT_FOLDER})")
        action.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help="print the result as JSON")


def _add_reviewer(parser: argparse.ArgumentParser, text: str) -> None:
    """The option that names the reviewer; `--reader` is its old spelling."""
    names = parser.add_mutually_exclusive_group(required=True)
    names.add_argument("--reviewer", metavar="NAME", help=text)
    names.add_argument("--reader", dest="reviewer", help=argparse.SUPPRESS)


def run(arguments: argparse.Namespace) -> int:
    """Do the action; 2 if a decision or a file is invalid."""
    actions = {"list": _list, "blind": _blind, "record": _record, "agreement": _agreement, "proof": _proof}
    actions[arguments.action](arguments)
    return 0


def _list(arguments: argparse.Namespace) -> None:
    from taxonomy.matching.decisions import decisions, standing, waiting

    given = decisions(arguments.folder)
    open_subjects = waiting(given)
    read = {decision.subject for decision in standing(given) if decision.what == "match"}
    words = _unsettled_words(arguments.raw, read)
    if arguments.json:
        rows = [{"source": s, "words": w, "found": f, "rule": r, "items": n} for (s, w, f, r), n in words.most_common()]
        print_json({"schema": SCHEMA, "waiting": [{"what": w, "subject": s} for w, s in open_subjects], "words": rows})
        return
    title = f"subjects that wait for a further reviewer: {len(open_subjects)}"
    print_table(["what", "subject"], open_subjects, title=title)
    if arguments.raw:
        shown = words.most_common(None if arguments.all else SHOWN)
        title = f"words that wait for a first reviewer: {len(words)} (of {sum(words.values())} items)"
        print_table(["source", "words", "found", "rule", "items"], [(*key, n) for key, n in shown], title=title)


def _unsettled_words(raw: Iterable[str], read: Container[str]) -> Counter[tuple[str, str, str | None, str]]:
    """Items by (source, words, concept below the threshold, rule) that no reviewer has read and no rule settles."""
    from metric_tree.pipeline.ingest import blocks, items_of, raw_files
    from taxonomy.matching.decisions import EVERY_SOURCE
    from taxonomy.matching.matcher import default_matcher

    words: Counter[tuple[str, str, str | None, str]] = Counter()
    for block in blocks(raw_files(map(Path, raw))):
        for item in items_of(block):
            finding = default_matcher().finding(item.source, item.category_path, item.title, item.synset)
            subjects = (f"{item.source}: {finding.subject}", f"{EVERY_SOURCE}: {finding.subject}")
            if not finding.settled and not any(subject in read for subject in subjects):
                words[item.source, finding.subject, finding.concept, finding.rule] += 1
    return words


def _blind(arguments: argparse.Namespace) -> None:
    from taxonomy.categories import insertions
    from taxonomy.matching.decisions import decisions

    if arguments.limit is not None and arguments.limit < 1:
        raise InputError(f"--limit: expected a number from 1; found {arguments.limit}")
    given = [d for d in decisions(arguments.folder) if d.what == arguments.what]
    read = {d.subject for d in given if d.reviewer == arguments.reviewer}
    names = {i.id: i.name for i in insertions().values()} if arguments.what == "insertion" else {}
    todo = sorted(({d.subject for d in given} | set(names)) - read)
    if arguments.source is not None:
        todo = [subject for subject in todo if subject.startswith(f"{arguments.source}: ")]
    random.Random(arguments.seed).shuffle(todo)  # noqa: S311 - an order, not a secret
    todo = todo[: arguments.limit]
    examples = _examples(arguments.raw, set(todo))
    rows = [
        {"subject": subject, "words": names.get(subject, subject.partition(": ")[2])} | examples.get(subject, {})
        for subject in todo
    ]
    if arguments.json:
        print_json(rows)
    else:
        columns = ("subject", "words", *(("title", "size", "picture", "page") if arguments.raw else ()))
        cells = [[row.get(column, "") for column in columns] for row in rows]
        print_table(columns, cells, title=f"{len(rows)} subjects for {arguments.reviewer}")


def _examples(raw: Sequence[Path], subjects: set[str]) -> dict[str, dict[str, str]]:
    """Title, size in mm, image and page of the first item of each subject that the raw items have."""
    if not raw:
        return {}
    from metric_tree.pipeline.ingest import blocks, items_of, raw_files
    from taxonomy.matching.decisions import EVERY_SOURCE
    from taxonomy.matching.matcher import default_matcher

    examples: dict[str, dict[str, str]] = {}
    for item in (item for block in blocks(raw_files(raw)) for item in items_of(block)):
        words = default_matcher().finding(item.source, item.category_path, item.title, item.synset).subject
        for subject in {f"{item.source}: {words}", f"{EVERY_SOURCE}: {words}"} & subjects - set(examples):
            size = " x ".join(f"{value:.4g}" for value in item.extents_mm or ())
            links = {"picture": next(iter(item.images), ""), "page": item.url or ""}
            examples[subject] = {"title": item.title or "", "size": size, **links}
        if len(examples) == len(subjects):
            break
    return examples


def _record(arguments: argparse.Namespace) -> None:
    from taxonomy.matching.decisions import (
        NONE,
        WITHDRAWN,
        BadDecision,
        Decision,
        decisions,
        record_decision,
        record_folder,
    )
    from taxonomy.matching.lexicon import default_lexicon
    from taxonomy.words.spelling import fold_text

    source, separator, words = arguments.subject.partition(": ")
    if separator and arguments.what == "match":
        _expect_source(source, decisions(arguments.folder), arguments.sources)
    elif arguments.what == "insertion" and arguments.subject not in default_lexicon().inserted:
        nearest = near_spellings(arguments.subject, sorted(default_lexicon().inserted), n=OFFERED, cutoff=0)
        raise BadDecision(
            f"subject: expected an insertion ({', '.join(nearest)} are nearest); found {arguments.subject!r}"
        )
    concept = None if arguments.decision == NONE else arguments.decision
    withdrawn = concept == WITHDRAWN
    if concept is not None and not withdrawn:
        if not default_lexicon().knows(concept):
            raise BadDecision(f"decision: expected a WordNet 3.0 synset, an mt: id or {NONE}; found {concept!r}")
        concept = default_lexicon().canonical(concept)
    with in_file("review record", BadDecision):
        decision = Decision(
            what=arguments.what,
            subject=f"{source}: {fold_text(words)}" if separator else arguments.subject,
            decision=concept,
            reviewer=arguments.reviewer,
            when=datetime.now(UTC).strftime("%Y-%m-%dT%H:%MZ"),
            why=arguments.why,
            blind=not (arguments.amend or withdrawn),
        )
    folder = arguments.folder or record_folder()
    file = folder / "recorded.jsonl"
    record_decision(decision, file, amend=arguments.amend or withdrawn)
    if arguments.json:
        print_json({"schema": SCHEMA, "recorded": decision.subject, "file": str(file)})
    else:
        row = (decision.subject, decision.decision or NONE, decision.reviewer)
        print_table(["subject", "decision", "reviewer"], [row], title=str(file))


def _expect_source(name: str, given: Sequence[Decision], folder: Path | None) -> None:
    """See that a decision is about a source that raw items can have: declared, a site, or decided about before.

    The items of a generic crawl have their host as source, so that any host's name is one.
    """
    from crawler.imports.declaration import declared_sources
    from crawler.sites.registry import GENERIC, SITES
    from taxonomy.matching.decisions import EVERY_SOURCE, BadDecision

    known = {EVERY_SOURCE, *UNDECLARED, *(site.name for site in (GENERIC, *SITES)), *declared_sources(folder)}
    known |= {decision.subject.partition(": ")[0] for decision in given if decision.what == "match"}
    if name not in known and not HOST.fullmatch(name):
        nearest = near_spellings(name, sorted(known), n=OFFERED, cutoff=0) or sorted(known)
        expected = f"a source ({', '.join(nearest)} are nearest), or {EVERY_SOURCE} for all"
        raise BadDecision(f"subject: expected {expected}; found {name!r}")


def _proof(arguments: argparse.Namespace) -> None:
    from explorer.pages.proofreading_page import proofreading_page
    from metric_tree.tree import open_tree

    if arguments.limit < 1:
        raise InputError(f"--limit: expected a number from 1; found {arguments.limit}")
    page = proofreading_page(open_tree(arguments.tree), arguments.limit)
    with whole_file(arguments.out, "--out") as part:
        part.write_text(page, encoding="utf-8")
    if arguments.json:
        print_json({"schema": SCHEMA, "page": str(arguments.out)})
    else:
        print_table(["page"], [(str(arguments.out),)])


def _agreement(arguments: argparse.Namespace) -> None:
    from taxonomy.matching.decisions import NONE, agreement, decisions, disagreements

    given = decisions(arguments.folder)
    kinds = {what: agreement(given, what) for what in ("match", "insertion")}
    differ = [(a.what, a.subject, a.decision or NONE, b.decision or NONE) for a, b in disagreements(given)]
    if arguments.json:
        shares = {w: {"n": k.n, "share": k.share, "kappa": k.kappa} for w, k in kinds.items() if k.n}
        columns = ("what", "subject", "first", "second")
        rows = [dict(zip(columns, row, strict=True)) for row in differ]
        print_json({"schema": SCHEMA, "agreement": shares, "differ": rows})
        return
    shown = [(what, k.n, f"{k.share:.3f}", f"{k.kappa:.3f}") for what, k in kinds.items() if k.n]
    print_table(["what", "read twice", "same", "kappa"], shown, title="First and second readings")
    print_table(["what", "subject", "first", "second"], differ, title=f"{len(differ)} go to a third reviewer")
