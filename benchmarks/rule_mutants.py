"""How many changed rules the tests notice: a seeded sample of thresholds and conditions.

    python -m benchmarks.rule_mutants GROUP --work DIR --seed 7 [--count 40] [--skip 3,17] [--only 5] [--list]

Half of the sample are named numbers that a comparison, a minimum or a maximum uses (times or divided by 1.3, integers
by at least 1). The others are conditions: a reversed comparison, `and` for `or`, a guard that never holds, and the
opposite of a truth value that is returned early. `--list` prints the sample. `--skip` leaves out draws that no user can
see (threads, sizes of blocks) and takes the next ones instead. Each mutant is tried in a copy of the last commit
against the tests that run its lines or those that use its number, the nearest and quickest first.
"""

from __future__ import annotations

import argparse
import ast
import json
import random
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.mutants import Covering, copy_repository, run_tests

GROUPS = {
    "estimator": ("estimator", "capture", "models3d"),
    "dataset": ("metric_base", "crawler", "taxonomy", "metric_tree"),
    "programs": ("insertion", "explorer", "metric_cli"),
}
#: Factor of a changed number.
FACTOR = 1.3
#: Seconds of wall time after which a mutant is undecided.
LIMIT_S = 300
OPERATORS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", (">=", ">")),
    ast.LtE: ("<=", (">", ">=")),
    ast.Gt: (">", ("<=", "<")),
    ast.GtE: (">=", ("<", "<=")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
LIMITING = {"min", "max", "clip", "minimum", "maximum"}


@dataclass(frozen=True)
class Site:
    """A place that can be changed: `old` in the bytes `start` to `end` of `file` becomes one of `new`."""

    file: str
    line: int
    kind: str
    name: str
    start: int
    end: int
    old: str
    new: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.kind} {self.name}: {self.old!r} -> {self.new[0]!r}"


class Source:
    """A module with the places that can be changed in it."""

    def __init__(self, root: Path, path: Path) -> None:
        self.file = str(path.relative_to(root))
        self.raw = path.read_bytes()
        self.tree = ast.parse(self.raw)
        lines = self.raw.splitlines(keepends=True)
        self._starts = [sum(map(len, lines[:index])) for index in range(len(lines))]

    def limits(self) -> Iterator[str]:
        """The names that a comparison, a minimum or a maximum uses."""
        for node in ast.walk(self.tree):
            limiting = isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in LIMITING
            if isinstance(node, ast.Compare) or limiting:
                for inner in ast.walk(node):
                    if isinstance(inner, ast.Name | ast.Attribute):
                        yield _name(inner)

    def uses(self, name: str) -> list[int]:
        """The lines inside functions that use a name."""
        functions = (node for node in ast.walk(self.tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
        nodes = (node for function in functions for node in ast.walk(function))
        return sorted(
            {node.lineno for node in nodes if isinstance(node, ast.Name | ast.Attribute) and _name(node) == name}
        )

    def numbers(self, limits: set[str]) -> Iterator[Site]:
        """Named numbers of the module."""
        for node in self.tree.body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                continue
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]*", target.id) and target.id in limits:
                value = _number(node.value)
                if value:
                    yield self._site(node.value, "number", target.id, _changed_numbers(value))

    def conditions(self) -> Iterator[Site]:
        """Comparisons, combined conditions, guards and truth values that are returned, inside functions."""
        for function in ast.walk(self.tree):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                for node in _own_nodes(function):
                    yield from self._changes(node, function.name)

    def _changes(self, node: ast.AST, name: str) -> Iterator[Site]:
        if isinstance(node, ast.Compare):
            operands = [f"({self._text(part)})" for part in (node.left, *node.comparators)]
            for changed, operator in enumerate(node.ops):
                new = []
                for replacement in OPERATORS[type(operator)][1]:
                    symbols = [OPERATORS[type(each)][0] for each in node.ops]
                    symbols[changed] = replacement
                    new.append(
                        "("
                        + operands[0]
                        + "".join(f" {s} {o}" for s, o in zip(symbols, operands[1:], strict=True))
                        + ")"
                    )
                yield self._site(node, "comparison", name, tuple(new))
        if isinstance(node, ast.BoolOp):
            word = " or " if isinstance(node.op, ast.And) else " and "
            yield self._site(
                node, "and/or", name, ("(" + word.join(f"({self._text(value)})" for value in node.values) + ")",)
            )
        if (
            isinstance(node, ast.If)
            and not node.orelse
            and isinstance(node.body[-1], ast.Return | ast.Raise | ast.Continue | ast.Break)
        ):
            yield self._site(node.test, "guard", name, ("False",))
        if isinstance(node, ast.If):
            for last in (node.body[-1], *node.orelse[-1:]):
                if (
                    isinstance(last, ast.Return)
                    and isinstance(last.value, ast.Constant)
                    and isinstance(last.value.value, bool)
                ):
                    yield self._site(last.value, "returned", name, (repr(not last.value.value),))

    def _site(self, node: ast.expr, kind: str, name: str, new: tuple[str, ...]) -> Site:
        start, end = self._span(node)
        return Site(self.file, node.lineno, kind, name, start, end, self._text(node), new)

    def _span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._starts[node.lineno - 1] + node.col_offset, self._starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, node: ast.expr) -> str:
        start, end = self._span(node)
        return self.raw[start:end].decode()


def _name(node: ast.Name | ast.Attribute) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr


def _own_nodes(function: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a function without those of functions inside it."""
    for child in ast.iter_child_nodes(function):
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield child
            yield from _own_nodes(child)


def _number(node: ast.expr) -> float | None:
    """The value of an expression of numbers, or None."""
    if any(isinstance(part, ast.Name | ast.Call | ast.Attribute) for part in ast.walk(node)):
        return None
    try:
        value = eval(ast.unparse(node), {"__builtins__": {}})  # noqa: S307 - numbers of this repository
    except (TypeError, ValueError):
        return None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _changed_numbers(value: float) -> tuple[str, ...]:
    if isinstance(value, int):
        return repr(max(round(value * FACTOR), value + 1)), repr(min(round(value / FACTOR), value - 1))
    return repr(float(f"{value * FACTOR:.6g}")), repr(float(f"{value / FACTOR:.6g}"))


def sample(sources: list[Source], folders: tuple[str, ...], seed: int, count: int) -> list[Site]:
    """The draws of a seed, each with one change; their order does not depend on their number."""
    limits = {name for source in sources for name in source.limits()}
    inside = [source for source in sources if source.file.split("/")[0] in folders]
    pools = [
        [site for source in inside for site in source.numbers(limits)],
        [site for source in inside for site in source.conditions()],
    ]
    chance = random.Random(seed)  # noqa: S311
    for pool in pools:
        chance.shuffle(pool)
    drawn: list[Site] = []
    while len(drawn) < count and all(pools):
        site = pools[chance.random() < 0.5].pop()
        drawn.append(Site(**asdict(site) | {"new": (chance.choice(site.new),)}))
    return drawn


def nearest_tests(site: Site, sources: list[Source], covering: Covering, seconds: float) -> list[str]:
    """The tests that run the lines of a site, or those that use its number, the nearest and quickest first."""
    if site.kind == "number":
        places = [(source.file, line) for source in sources for line in source.uses(site.name)]
        own = [place for place in places if place[0].split("/")[0] == site.file.split("/")[0]]
        places = [place for place in places if place[0] == site.file] or own or places
    else:
        places = [(site.file, site.line)]
    tests = {name: taken for file, line in places for name, taken in covering.of_line(file, line)}
    folder = f"tests/{site.file.rpartition('/')[0]}"
    ordered = sorted(tests.items(), key=lambda test: (not test[0].startswith(folder), test[1]))
    chosen: list[str] = []
    for name, taken in ordered:
        if not chosen or seconds - taken >= 0:
            chosen.append(name)
            seconds -= taken
    return chosen


def main() -> None:
    """Try the sample, and print one line per mutant and the share that the tests notice."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("group", choices=GROUPS)
    parser.add_argument("--work", type=Path, required=True, help="the copy of the repository, and its coverage")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=40, help="mutants without the skipped ones (default: %(default)s)")
    parser.add_argument("--skip", default="", help="numbers of draws that decide nothing that a user sees")
    parser.add_argument("--only", default="", help="numbers of draws that are tried")
    parser.add_argument("--seconds", type=float, default=15, help="for the tests of a mutant (default: %(default)s)")
    parser.add_argument("--list", action="store_true", help="print the sample")
    arguments = parser.parse_args()
    copy = arguments.work.resolve() / "copy"
    if not copy.is_dir():
        copy_repository(copy)
    copy = copy.resolve()
    everything = tuple(folder for folders in GROUPS.values() for folder in folders)
    sources = [Source(copy, path) for folder in everything for path in sorted((copy / folder).rglob("*.py"))]
    skipped, only = ({int(word) for word in words.split(",") if word} for words in (arguments.skip, arguments.only))
    drawn = list(enumerate(sample(sources, GROUPS[arguments.group], arguments.seed, arguments.count + len(skipped))))
    chosen = [(number, site) for number, site in drawn if number not in skipped and (not only or number in only)]
    if arguments.list:
        for number, site in drawn:
            print(number, "SKIPPED" if number in skipped else "", site)
        return
    covering = Covering(copy, everything)
    verdicts = []
    for number, site in chosen:
        tests = nearest_tests(site, sources, covering, arguments.seconds)
        verdicts.append(_verdict(site, tests, copy))
        print(number, verdicts[-1], site, f"{len(tests)} tests", flush=True)
        with (arguments.work / f"rules.{arguments.group}.{arguments.seed}.jsonl").open("a", encoding="utf-8") as file:
            file.write(
                json.dumps({"number": number, "verdict": verdicts[-1], "site": asdict(site), "tests": tests}) + "\n"
            )
    print(f"{verdicts.count('killed')} of {len(verdicts)} killed, {verdicts.count('undecided')} undecided")


def _verdict(site: Site, tests: list[str], copy: Path) -> str:
    source = copy / site.file
    whole = source.read_bytes()
    source.write_bytes(whole[: site.start] + site.new[0].encode() + whole[site.end :])
    try:
        status = run_tests(["-x", *tests], copy, LIMIT_S) if tests else 0
    finally:
        source.write_bytes(whole)
    return "undecided" if status is None else "SURVIVED" if status == 0 else "killed"


if __name__ == "__main__":
    main()
