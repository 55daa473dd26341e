"""OpenSfM's tracks.csv: which point was seen where, one observation a line, tab separated, in versions 0 to 2."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from estimator.records.scene import MAX_COORDINATE
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import InputError, Unquoted
from metric_base.input_files import read_bytes

__all__ = ["read_observations"]

_FIRST_BYTES = 1000  # hold the line of the version and the start of the first observation
_VERSION = b"OPENSFM_TRACKS_VERSION"
#: The columns that every version begins with; what follows (scale, colour, segmentation) is not needed.
_COLUMNS = {"f0": pa.dictionary(pa.int32(), pa.string()), "f1": pa.string(), "f3": pa.float64(), "f4": pa.float64()}


def read_observations(
    file: Path, images: Sequence[str], tracks: Sequence[str]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows of `images` (m,), rows of `tracks` (m,) and normalised positions (m, 2) of the observations of both.

    Observations of other images or of tracks without a point are left out. InputError for a file that is no table
    of that kind.
    """
    table = _table(file)
    image_rows = _rows_in(table["f0"], images)
    track_rows = _rows_in(table["f1"], tracks)
    known = (image_rows >= 0) & (track_rows >= 0)
    positions = np.column_stack([table[column].to_numpy()[known] for column in ("f3", "f4")])
    good = np.abs(positions) < MAX_COORDINATE  # false for NaN as well
    if not good.all():
        row = int((~good).any(axis=1).argmax())
        expected = f"finite numbers below {MAX_COORDINATE:g}"
        raise InputError.at(file, "position", expected, positions[row].tolist())
    return image_rows[known], track_rows[known], positions


def _table(file: Path) -> pa.Table:
    head = read_bytes(file, most=_FIRST_BYTES)
    has_version = head.startswith(_VERSION)
    if has_version and not head.partition(b"\n")[2].strip():
        raise InputError.at(file, "observations", "at least one line", 0)
    try:
        return _observations_of(file, has_version, in_threads=True)
    except (pa.ArrowInvalid, KeyError):
        pass
    try:  # threads report whichever error they meet first; alone, the reader always reports the same one
        return _observations_of(file, has_version, in_threads=False)
    except (pa.ArrowInvalid, KeyError) as error:
        expected = "tab-separated image, track, feature, x, y, ..."
        raise InputError.at(file, "observations", expected, Unquoted(str(error))) from None


def _observations_of(file: Path, has_version: bool, in_threads: bool) -> pa.Table:
    # By its name: Arrow's threads let go of a Python object only after an error is told, and tracemalloc, stopped
    # meanwhile, crashes in them (CPython 128679).
    return csv.read_csv(
        str(file),
        read_options=csv.ReadOptions(
            autogenerate_column_names=True, skip_rows=int(has_version), use_threads=in_threads
        ),
        parse_options=csv.ParseOptions(delimiter="\t", quote_char=False),
        convert_options=csv.ConvertOptions(column_types=_COLUMNS, include_columns=list(_COLUMNS), null_values=[]),
    )


def _rows_in(column: pa.ChunkedArray, names: Sequence[str]) -> IntArray:
    """(m,) row of each value in `names`, -1 where it is not there; a dictionary column is looked up once a value."""
    if pa.types.is_dictionary(column.type):
        encoded = column.combine_chunks()
        rows = _rows_in(pa.chunked_array([encoded.dictionary]), names)
        return np.asarray(rows[encoded.indices.to_numpy()])
    rows = pc.index_in(column, value_set=pa.array(names, pa.string()))
    return np.asarray(pc.fill_null(rows, -1).to_numpy(), dtype=np.int64)
