"""`metric-tree review`: open subjects, blind lists, records of decisions, agreement, and the proofreading form."""

from __future__ import annotations

import argparse
import random
import re
from datetime import UTC, datetime

from metric_base.errors import InputError, in_file
from metric_base.files import write_whole
from metric_base.spelling import near_spellings
from metric_cli.parser import OutputFile, add_tree, input_path, output_folder
from metric_cli.tables import print_json, print_result, print_table

HELP = "List open subjects, print a blind list, record a decision, compute the agreement, or write a proofreading form."

SCHEMA = "metric-tree/review/1"

#: Folders of decisions if no folder is named.
DEFAULT_FOLDER = "default: ./decisions if it exists, that of the user, and that of the project"

#: Sources of raw items that are neither declared nor sites: norms, judged ranges, and the spider of Wikidata.
UNDECLARED = ("norms", "judged", "wikidata")

#: Host name, which is the source of items of `crawl generic`: `shop.example`.
HOST = re.compile(r"[a-z0-9-]+(\.[a-z0-9-]+)*\.[a-z]{2,}")

#: Number of similar names in an error message.
N_SUGGESTIONS = 3

#: Maximum number of printed words without `--all`.
MAX_WORDS = 40

#: Default number of nodes of the proofreading form, about an hour of work.
N_PROOFREAD = 100

#: Default seed of the order of a blind list, which differs from the order of the first reviewer.
SEED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    actions = parser.add_subparsers(dest="action", metavar="list|blind|record|agreement|proof", required=True)
    # fmt: off
    waits = actions.add_parser("list", help="open subjects, and words of raw items that no rule settles")
    waits.add_argument("raw", metavar="RAW", nargs="*", type=input_path,
        help="*.jsonl, *.jsonl.gz, or folders of them, to search for unsettled words")
    waits.add_argument("--all", action="store_true", help=f"print all words, not only {MAX_WORDS}")
    blind = actions.add_parser("blind", help="subjects that a reviewer has not read, shuffled and without decisions")
    blind.add_argument("raw", metavar="RAW", nargs="*", type=input_path, help="raw items for examples of the subjects")
    blind.add_argument("--reviewer", metavar="NAME", required=True, help="the reviewer")
    blind.add_argument("--source", help="only subjects of this source")
    blind.add_argument("--limit", type=int, metavar="N", help="at most N subjects")
    blind.add_argument("--what", choices=["match", "insertion"], default="match", help="kind of decision")
    blind.add_argument("--seed", type=int, default=SEED, help="seed of the order")
    record = actions.add_parser("record", help="record a decision")
    record.add_argument("subject", help="'SOURCE: words' or '*: words' of a match, the mt: id of an insertion")
    record.add_argument("decision", help="a synset, an mt: id, none, or withdrawn; of an insertion its parent, or none")
    record.add_argument("--amend", action="store_true", help="replace an earlier decision of the same reviewer")
    name = "name of a person, or 'program: DESCRIPTION'"
    record.add_argument("--reviewer", metavar="NAME", required=True, help=name)
    record.add_argument("--what", choices=["match", "insertion"], default="match", help="kind of decision")
    record.add_argument("--sources", type=input_path, metavar="DIR", help="folder of further declarations of sources")
    record.add_argument("--why", default="", help="reason, one line")
    actions.add_parser("agreement", help="Cohen's kappa of first and second readings, and the disagreements")
    proof = actions.add_parser("proof", help="form for proofreading the most used sizes with little evidence")
    proof.add_argument("--out", type=OutputFile(), metavar="FILE.html", required=True, help="the page")
    proof.add_argument("--limit", type=int, default=N_PROOFREAD, metavar="N",
        help="number of nodes (default: %(default)s)")
    # fmt: on
    add_tree(proof)
    for action in actions.choices.values():
        kind = output_folder if action is record else input_path
        action.add_argument("--folder", type=kind, metavar="DIR", help=f"folder of the decisions ({DEFAULT_FOLDER})")
        action.add_argument("--json", action="store_true", default=argparse.SUPPRESS, help="print the result as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Run the action; 2 if a decision or a file is invalid."""
    actions = {
        "list": list_subjects,
        "blind": print_blind_list,
        "record": record,
        "agreement": print_agreement,
        "proof": write_form,
    }
    actions[arguments.action](arguments)


def list_subjects(arguments: argparse.Namespace) -> None:
    """Print the subjects that need another reviewer, and words of raw items that no rule settles."""
    from metric_tree.pipeline.review_subjects import unsettled_words
    from taxonomy.matching.decisions import decisions, standing, waiting

    given = decisions(arguments.folder)
    open_subjects = waiting(given)
    settled = {decision.subject for decision in standing(given) if decision.what == "match"}
    words = unsettled_words(arguments.raw, settled)
    columns = ["source", "words", "found", "rule", "items"]
    rows = [(*key, n) for key, n in words.most_common()]
    if arguments.json:
        named = [dict(zip(columns, row, strict=True)) for row in rows]
        print_json({"schema": SCHEMA, "waiting": [{"what": w, "subject": s} for w, s in open_subjects], "words": named})
        return
    title = f"subjects that wait for a further reviewer: {len(open_subjects)}"
    print_table(["what", "subject"], open_subjects, title=title)
    if arguments.raw:
        title = f"words that wait for a first reviewer: {len(words)} (of {sum(words.values())} items)"
        print_table(columns, rows if arguments.all else rows[:MAX_WORDS], title=title)


def print_blind_list(arguments: argparse.Namespace) -> None:
    """Print subjects that the reviewer has not read, in random order and without the decisions of others."""
    from metric_tree.pipeline.review_subjects import subject_examples
    from taxonomy.categories import insertions
    from taxonomy.matching.decisions import decisions

    if arguments.limit is not None and arguments.limit < 1:
        raise InputError(f"--limit: expected a number from 1; found {arguments.limit}")
    given = [decision for decision in decisions(arguments.folder) if decision.what == arguments.what]
    read = {decision.subject for decision in given if decision.reviewer == arguments.reviewer}
    names = {i.id: i.name for i in insertions().values()} if arguments.what == "insertion" else {}
    todo = sorted(({decision.subject for decision in given} | set(names)) - read)
    if arguments.source is not None:
        todo = [subject for subject in todo if subject.startswith(f"{arguments.source}: ")]
    random.Random(arguments.seed).shuffle(todo)  # noqa: S311 - an order, not a secret
    todo = todo[: arguments.limit]
    examples = subject_examples(arguments.raw, todo) if arguments.raw else {}
    rows = [
        {"subject": subject, "words": names.get(subject, subject.partition(": ")[2])} | examples.get(subject, {})
        for subject in todo
    ]
    columns = ("subject", "words", *(("title", "size", "picture", "page") if arguments.raw else ()))
    cells = [[row.get(column, "") for column in columns] for row in rows]
    print_result(arguments.json, rows, columns, cells, f"{len(rows)} subjects for {arguments.reviewer}")


def record(arguments: argparse.Namespace) -> None:
    """Record a decision. Raises BadDecision if its source, subject or concept does not exist."""
    from crawler.imports.declaration import declared_sources
    from crawler.sites.registry import GENERIC, SITES
    from taxonomy.matching import decisions
    from taxonomy.matching.lexicon import default_lexicon
    from taxonomy.words.spelling import fold_text

    source, separator, words = arguments.subject.partition(": ")
    if separator and arguments.what == "match" and not HOST.fullmatch(source):
        # Sources of raw items: declared, sites, and those of earlier decisions; a generic crawl has its host name
        known = {decisions.EVERY_SOURCE, *UNDECLARED, *(site.name for site in (GENERIC, *SITES))}
        known |= {d.subject.partition(": ")[0] for d in decisions.decisions(arguments.folder) if d.what == "match"}
        known |= set(declared_sources(arguments.sources))
        if source not in known:
            nearest = near_spellings(source, sorted(known), n=N_SUGGESTIONS, cutoff=0) or sorted(known)
            expected = f"a source ({', '.join(nearest)} are nearest), or {decisions.EVERY_SOURCE} for all"
            raise decisions.BadDecision(f"subject: expected {expected}; found {source!r}")
    elif arguments.what == "insertion" and arguments.subject not in default_lexicon().inserted:
        nearest = near_spellings(arguments.subject, sorted(default_lexicon().inserted), n=N_SUGGESTIONS, cutoff=0)
        expected = f"an insertion ({', '.join(nearest)} are nearest)"
        raise decisions.BadDecision(f"subject: expected {expected}; found {arguments.subject!r}")
    concept = None if arguments.decision == decisions.NONE else arguments.decision
    is_withdrawn = concept == decisions.WITHDRAWN
    if concept is not None and not is_withdrawn:
        if not default_lexicon().knows(concept):
            raise decisions.BadDecision(
                f"decision: expected a WordNet 3.0 synset, an mt: id or {decisions.NONE}; found {concept!r}"
            )
        concept = default_lexicon().canonical(concept)
    with in_file("review record", decisions.BadDecision):
        decision = decisions.Decision(
            what=arguments.what,
            subject=f"{source}: {fold_text(words)}" if separator else arguments.subject,
            decision=concept,
            reviewer=arguments.reviewer,
            when=datetime.now(UTC).strftime("%Y-%m-%dT%H:%MZ"),
            why=arguments.why,
            blind=not (arguments.amend or is_withdrawn),
        )
    file = (arguments.folder or decisions.record_folder()) / "recorded.jsonl"
    decisions.record_decision(decision, file, amend=arguments.amend or is_withdrawn)
    row = (decision.subject, decision.decision or decisions.NONE, decision.reviewer)
    recorded = {"schema": SCHEMA, "recorded": decision.subject, "file": str(file)}
    print_result(arguments.json, recorded, ["subject", "decision", "reviewer"], [row], str(file))


def print_agreement(arguments: argparse.Namespace) -> None:
    """Print the agreement of first and second readings, and the subjects with different decisions."""
    from taxonomy.matching.decisions import NONE, agreement, decisions, disagreements

    given = decisions(arguments.folder)
    kinds = [(what, found) for what in ("match", "insertion") if (found := agreement(given, what)).n]
    columns = ["what", "subject", "first", "second"]
    differ = [(a.what, a.subject, a.decision or NONE, b.decision or NONE) for a, b in disagreements(given)]
    if arguments.json:
        shares = {what: {"n": found.n, "share": found.share, "kappa": found.kappa} for what, found in kinds}
        rows = [dict(zip(columns, row, strict=True)) for row in differ]
        print_json({"schema": SCHEMA, "agreement": shares, "differ": rows})
        return
    rows_of_kinds = [(what, found.n, f"{found.share:.3f}", f"{found.kappa:.3f}") for what, found in kinds]
    print_table(["what", "read twice", "same", "kappa"], rows_of_kinds, title="First and second readings")
    print_table(columns, differ, title=f"{len(differ)} go to a third reviewer")


def write_form(arguments: argparse.Namespace) -> None:
    """Write the form for proofreading."""
    from explorer.pages.proofreading_page import proofreading_page
    from metric_tree.tree import open_tree

    if arguments.limit < 1:
        raise InputError(f"--limit: expected a number from 1; found {arguments.limit}")
    page = proofreading_page(open_tree(arguments.tree), arguments.limit)
    write_whole(arguments.out, page, "--out")
    page_file = str(arguments.out)
    print_result(arguments.json, {"schema": SCHEMA, "page": page_file}, ["page"], [(page_file,)])
