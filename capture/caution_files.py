"""The file of a work folder with the warnings about its reconstruction, which every result repeats."""

from __future__ import annotations

import json
from pathlib import Path

from metric_base.errors import InputError, in_file
from metric_base.files import write_whole
from metric_base.input_files import read_json
from metric_base.parsing import json_array

CAUTIONS_FILE = "cautions.json"
SCHEMA = "metric-tree/cautions/1"


def write_cautions(cautions: tuple[str, ...], folder: Path) -> None:
    """Write the warnings to a work folder."""
    text = json.dumps({"schema": SCHEMA, "cautions": list(cautions)}) + "\n"
    write_whole(folder / CAUTIONS_FILE, text, "--work", "metric-tree/cautions/")


def read_cautions(folder: Path) -> tuple[str, ...]:
    """Return the warnings of a work folder, an empty tuple if the file is missing.

    Raises
    ------
    InputError
        The file is damaged.
    """
    file = folder / CAUTIONS_FILE
    if not file.is_file():
        return ()
    with in_file(file):
        record = read_json(file)
        rows = json_array(record.get("cautions") if isinstance(record, dict) else record)  # of version 1.0.0
    if not all(isinstance(row, str) for row in rows):
        raise InputError.at(file, "cautions", "sentences", rows)
    return tuple(rows)
