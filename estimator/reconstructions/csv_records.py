"""Records of a file of comma-separated values, with every error as one line that names the file."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from metric_base.errors import InputError, Unquoted
from metric_base.input_files import read_text

__all__ = ["csv_records"]


def csv_records(file: Path, text: str | None = None) -> tuple[list[str], list[tuple[int, dict[Any, Any]]]]:
    """Names of the columns, and each record with the number of its line; `text` stands in for the file's.

    A record that is too short has None in its last columns; what is too much is a list under the key None.

    Raises
    ------
    InputError
        The file cannot be read, or a line is no record.
    """
    reader = csv.DictReader((read_text(file) if text is None else text).splitlines(), skipinitialspace=True)
    try:
        names = list(reader.fieldnames or ())
        return names, [(reader.line_num, record) for record in reader]
    except csv.Error as error:
        line = reader.line_num + 1
        raise InputError.at(file, f"line {line}", "comma-separated values", Unquoted(str(error))) from None
