"""`--batch LIST`: run a command for each scene of a list in processes, and write a table with one row per scene."""

from __future__ import annotations

import argparse
import io
import os
import shlex
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError, Unquoted
from metric_base.escaping import visible
from metric_base.operating_system import n_cores
from metric_base.spelling import advice, near_spellings
from metric_cli.errors import EXIT_NEGATIVE_RESULT, EXIT_OK, INPUT_ERROR, INTERNAL_ERROR
from metric_cli.parser import (
    OneLineParser,
    OutputFile,
    add_overwrite,
    arguments_of,
    check_paths,
    input_path,
    new_folder,
    output_folder,
    parse_part,
)
from metric_cli.progress import progress_bars
from metric_cli.tables import print_json, print_table, warn

if TYPE_CHECKING:
    from metric_base.batch import BatchScene

#: Options that wait for a person or end the program; a list must not contain them.
INTERACTIVE_OPTIONS = frozenset({"--draw", "--place", "--view", "--help", "-h", "--version", "--completion", "--batch"})


@dataclass(frozen=True, slots=True)
class BatchCommand:
    """A command that works on lists of scenes.

    Attributes
    ----------
    program : str
        Name of the command.
    module : str
        Module whose `main(argv)` runs the command.
    prefix : tuple of str
        Arguments before those of a scene.
    parser : callable
        Return the parser of the arguments after `prefix`.
    columns : callable
        Return `status`, `scale`, `low` and `high` from the output of the command with `--json`.
    name_columns : tuple of str
        Columns of a list that name the input; the first one is the positional argument.
    has_other_lists : bool
        Whether the command has a `--batch` of its own, which is used unless `--out` is a Parquet file.
    """

    program: str
    module: str
    prefix: tuple[str, ...]
    parser: Callable[[], argparse.ArgumentParser]
    columns: Callable[[str], dict[str, Any]]
    name_columns: tuple[str, ...] = ("scene",)
    has_other_lists: bool = False


def add_batch(parser: argparse.ArgumentParser, *, with_out: bool = True, with_list: bool = True) -> None:
    """Add the options of batches; `with_out` and `with_list` if the command does not declare `--out` and `--batch`."""
    add = parser.add_argument_group("batch").add_argument
    # fmt: off
    if with_list:
        add("--batch", metavar="LIST", type=input_path,
            help="scenes, options as columns (CSV, Parquet, JSON Lines)")
    if with_out:
        add("--out", metavar="FILE", type=OutputFile("metric-tree/batch/"),
            help="with --batch: RESULTS.parquet, a row per scene")
    add("--jobs", metavar="N", type=int, help="with --batch: processes (default: one per core)")
    add("--part", metavar="I/N", help="with --batch: part I of N, for Slurm arrays")
    # fmt: on


def check_batch_options(options: argparse.Namespace, names: Sequence[str] = ("jobs", "part")) -> None:
    """Raise InputError if an option of batches is given without `--batch LIST`."""
    for name in names:
        if getattr(options, name) is not None:
            raise InputError(f"--{name}: expected --batch LIST and --out RESULTS.parquet; found none")


def batch_run(command: BatchCommand, argv: Sequence[str]) -> Callable[[], int] | None:
    """Return the run of a batch; None if the arguments do not request a batch of scenes."""
    if not any(word.partition("=")[0] == "--batch" for word in argv):
        return None
    parser = OneLineParser(prog=command.program, add_help=False, allow_abbrev=False)
    add_batch(parser)
    parser.add_argument("--json", action="store_true")
    add_overwrite(parser)
    options, words = argparse.ArgumentParser.parse_known_args(parser, list(argv))
    if command.has_other_lists and (options.out is None or options.out.suffix != ".parquet"):
        return None
    return partial(_run, command, parser, options, words)


def _run(
    command: BatchCommand, parser: argparse.ArgumentParser, options: argparse.Namespace, words: Sequence[str]
) -> int:
    """Run the batch, print the counts, and return the most serious status of its scenes; `words` are for all scenes."""
    from metric_base.batch import COMPLETE, SCHEMA, run_batch

    check_paths(parser, options)
    part = parse_part(options.part)
    if options.out is None or options.out.suffix != ".parquet" or not options.out.absolute().parent.is_dir():
        raise InputError(f"--out: expected a Parquet file in a folder that exists; found {options.out}")
    n_processes = n_cores() if options.jobs is None else options.jobs
    if n_processes < 1:
        raise InputError.at("--jobs", "processes", "a number from 1 on", n_processes)
    folder = options.batch.absolute().parent
    scenes = batch_scenes(command, options.batch, words)
    with progress_bars() as progress:
        counts, is_written = run_batch(
            scenes,
            partial(scene_row, command, folder),
            options.out.absolute(),
            part,
            n_processes,
            progress,
            lambda sentence: warn(sentence, command.program),
        )
    if not is_written:
        warn(f"{options.out}: not written yet: scenes of other parts have no result", command.program)
    by_status: Counter[str] = Counter()
    for (exit_status, status), count in counts.items():
        by_status[status if exit_status in COMPLETE else "failed"] += count
    if options.json:
        out = str(options.out) if is_written else None
        print_json({"schema": SCHEMA, "scenes": counts.total(), "counts": dict(sorted(by_status.items())), "out": out})
    else:
        print_table(["status", "scenes"], sorted(by_status.items()))
    found = {status for status, _ in counts}
    serious = (INTERNAL_ERROR, INPUT_ERROR, EXIT_NEGATIVE_RESULT)
    return next((status for status in serious if status in found), EXIT_OK)


def batch_scenes(command: BatchCommand, path: Path, words: Sequence[str]) -> list[BatchScene]:
    """Return the scenes of a list; relative paths of the list are relative to its folder.

    Parameters
    ----------
    command : BatchCommand
    path : Path
        The list.
    words : sequence of str
        Options of all scenes; a column of the same name replaces them.

    Raises
    ------
    InputError
        The list cannot be read, has an unknown column or a row without an input, or two rows have the same output.
    """
    from metric_base.batch import BatchScene, read_list, scene_key

    parser, folder = command.parser(), path.absolute().parent
    common = options_of(words)
    scenes, writers = [], dict[Path, str]()
    for place, row in read_list(path, command.name_columns[0]):
        cells = {name: value for name, value in row.items() if str(value) not in ("", "None", "nan")}
        name = next((str(cells[column]) for column in command.name_columns if column in cells), None)
        if name is None:
            raise InputError.at(place, command.name_columns[0], "a path", Unquoted("none"))
        positional = cells.pop(command.name_columns[0], None)
        extra = cells.pop("options", [])
        groups = common | {f"--{column.replace('_', '-')}": [] for column in cells}
        for column, value in cells.items():
            groups[f"--{column.replace('_', '-')}"] = option_words(parser, place, column, value)
        # a required option such as --model must precede the options that modify it
        required = [option for action in arguments_of(parser) if action.required for option in action.option_strings]
        ordered = sorted(groups, key=lambda option: option not in required)
        arguments = [] if positional is None else [f"./{positional}" if str(positional)[0] == "-" else str(positional)]
        arguments += [word for option in ordered for word in groups[option]]
        arguments += shlex.split(extra) if isinstance(extra, str) else map(str, extra)
        refused = [word for word in arguments if word.partition("=")[0] in INTERACTIVE_OPTIONS]
        try:
            parsed, unknown = argparse.ArgumentParser.parse_known_args(parser, [] if refused else arguments)
        except InputError:  # the error is reported when the scene is run
            parsed, unknown = argparse.Namespace(), []
        if refused or unknown:
            found = Unquoted(" ".join(refused or unknown))
            raise InputError.at(place, "options", f"options of {command.program} that are not interactive", found)
        new, written = output_paths(parser, parsed, folder)
        for output in written:
            if (other := writers.setdefault(output, place)) != place:
                raise InputError.at(place, "outputs", f"other outputs than those of {other}", str(output))
        key = scene_key(
            [command.program, *arguments], release_identity(getattr(parsed, "tree", None), folder), folder, written
        )
        scenes.append(BatchScene(name, tuple(arguments), key, tuple(new)))
    if not scenes:
        raise InputError.at(path, "list", "at least one scene", Unquoted("none"))
    return scenes


def options_of(words: Sequence[str]) -> dict[str, list[str]]:
    """Return the arguments of each option by its name; paths relative to the current folder become absolute.

    Raises
    ------
    InputError
        An argument does not belong to an option.
    """
    groups: dict[str, list[str]] = {}
    option = ""
    for word in words:
        if word.startswith("--"):
            option = word.partition("=")[0]
        groups.setdefault(option, []).append(str(Path(word).absolute()) if os.path.lexists(word) else word)
    if "" in groups:
        raise InputError(f"arguments: expected options and --batch LIST; found {groups[''][0]}")
    return groups


def output_paths(
    parser: argparse.ArgumentParser, options: argparse.Namespace, folder: Path
) -> tuple[list[Path], list[Path]]:
    """Return the outputs in `folder` that a command creates, and these with the work folders that it reuses."""
    new, written = [], []
    for action in arguments_of(parser):
        value, is_new = getattr(options, action.dest, None), isinstance(action.type, OutputFile)
        if value is not None and (is_new or action.type in (new_folder, output_folder)):
            written.append(folder / value)
            new += [] if action.type is output_folder else [folder / value]
    return new, written


def option_words(parser: argparse.ArgumentParser, place: str, column: str, value: Any) -> list[str]:
    """Return the arguments for a value of a column: a text, number, truth value, or list.

    The text of an option with several words is split as by a shell. For an option that may be repeated, each element of
    a list is a value. For an option with several words, it is a word, or a list of words for each use of the option.

    Raises
    ------
    InputError
        The column is not an option, or the value of a switch is neither true nor false.
    """
    option = f"--{column.replace('_', '-')}"
    action = parser._option_string_actions.get(option)
    if action is None:
        near = advice(near_spellings(option, parser._option_string_actions, n=1))
        raise InputError.at(place, str(column), f"a column that is an option of {parser.prog}", Unquoted(f"none{near}"))
    if action.nargs == 0:
        switch = {"true": [option], "1": [option], "false": [], "0": []}.get(str(value).lower())
        if switch is None:
            raise InputError.at(place, column, "true or false", value)
        return switch
    if action.nargs == "+":
        uses = value if isinstance(value, list) and all(isinstance(use, list) for use in value) else [value]
        return [
            word
            for use in uses
            for word in (option, *(map(str, use) if isinstance(use, list) else shlex.split(str(use))))
        ]
    values = value if isinstance(value, list) else [value]
    # a table with empty cells stores integers as floats
    return [f"{option}={int(one) if isinstance(one, float) and one.is_integer() else one}" for one in values]


@lru_cache
def release_identity(reference: str | None, folder: Path) -> str:
    """Return the SHA-256 of the manifest of a release, or the reference if there is no such release."""
    from metric_tree.release.registry import release_directory
    from metric_tree.release.release import MANIFEST, sha256

    local = folder / (reference or "")
    try:
        directory = local if reference is not None and local.is_dir() else release_directory(reference)
        return sha256(directory / MANIFEST)
    except (InputError, OSError):  # the run of the scene reports the error
        return str(reference)


def scene_row(command: BatchCommand, folder: Path, scene: BatchScene) -> dict[str, Any]:
    """Run the command of a scene in this process, and return its row of the table.

    Parameters
    ----------
    command : BatchCommand
    folder : Path
        Folder of the list, which becomes the current one.
    scene : BatchScene

    Returns
    -------
    dict
        Columns of `metric_base.batch.COLUMNS` except for `key`. `result` is the text that the command prints.
    """
    from metric_base.batch import COMPLETE

    os.chdir(folder)
    out, log, start = io.StringIO(), io.StringIO(), time.monotonic()
    with redirect_stdout(out), redirect_stderr(log):
        status: int = import_module(command.module).main([*command.prefix, *scene.words, "--json"])
    seconds = round(time.monotonic() - start, 3)
    row = {"scene": visible(scene.name), "seconds": seconds, "exit_status": status, "error": None}
    lines = [line for line in log.getvalue().splitlines() if line.startswith(f"{command.program}: ")]
    if status not in COMPLETE or not out.getvalue():
        line = lines[-1] if lines else log.getvalue().strip().rpartition("\n")[2]
        return row | {"error": visible(line.removeprefix(f"{command.program}: "))}
    return row | command.columns(out.getvalue()) | {"result": out.getvalue()}
