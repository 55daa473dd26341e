"""Rows that say the same object twice."""

from __future__ import annotations

import pickle
from collections import Counter

import numpy as np
import pyarrow as pa

from metric_tree.checks.duplicates import duplicates, size_codes
from metric_tree.pipeline.clean import PACKAGE, clean_unit, shard_classes
from metric_tree.pipeline.ingest import ROWS
from metric_tree.pipeline.shards import Unit

# Published values, written out so that a changed rule fails a test.
MAX_FIT_ROWS = 200

SIZES = [2000.0, 900.0, 850.0]


def repeats(*rows, common=frozenset({"sofa"})):
    """Rows of (source, kind, title, sizes), all of one node, shipped where the source starts with `o`."""
    sizes = np.full((len(rows), 6), np.nan)
    for number, row in enumerate(rows):
        stated = sorted(row[3], reverse=True)
        sizes[number, : len(row[3])] = row[3]
        sizes[number, 3 : 3 + len(stated)] = stated
    source, kind, title = ([row[column] for row in rows] for column in range(3))
    shipped = [name.startswith("o") for name in source]
    return duplicates(["n"] * len(rows), sizes, source, kind, title, shipped, common).tolist()


def test_the_same_figures_of_one_shop_count_once():
    assert repeats(("a", "product", "red", SIZES), ("a", "product", "blue", SIZES)) == [-1, 0]


def test_a_rounding_is_no_difference_and_a_centimetre_is():
    near, far = [2000.1, 900.0, 850.0], [2010.0, 900.0, 850.0]
    assert repeats(("a", "product", "x", SIZES), ("a", "product", "y", near), ("a", "product", "z", far)) == [-1, 0, -1]


def test_what_was_measured_one_by_one_is_never_a_repeat():
    assert repeats(("a", "measured", "", SIZES), ("a", "measured", "", SIZES)) == [-1, -1]


def test_one_number_alone_needs_the_same_title():
    rows = [("a", "product", "ten cents", [20.0, 20.0]), ("a", "product", "Ten Cents", [20.0, 20.0])]
    assert repeats(*rows, ("a", "product", "token", [20.0, 20.0])) == [-1, 0, -1]


def test_one_product_in_two_shops_is_recognized_by_a_word_of_its_name():
    rows = [("a", "product", "Sofa EKTORP grey", SIZES), ("b", "product", "Ektorp", SIZES)]
    assert repeats(*rows, ("c", "product", "sofa Klippan", SIZES)) == [-1, 0, -1]


def test_the_name_of_the_category_tells_nothing():
    assert repeats(("a", "product", "sofa", SIZES), ("b", "product", "sofa", SIZES)) == [-1, -1]


def test_the_row_that_ships_is_kept_then_the_stronger_kind():
    rows = [("a", "product", "ektorp", SIZES), ("open", "asset", "ektorp", SIZES)]
    assert repeats(*rows) == [1, -1]
    rows = [("a", "asset", "ektorp", SIZES), ("b", "product", "ektorp", SIZES)]
    assert repeats(*rows) == [1, -1]


def test_a_difference_of_a_tenth_of_a_per_cent_is_another_size():
    assert repeats(("a", "product", "x", SIZES), ("a", "product", "y", [2002.0, 900.0, 850.0])) == [-1, -1]


def test_a_word_of_three_letters_identifies_a_product_and_one_of_two_does_not():
    assert repeats(("a", "product", "Sofa Kly", SIZES), ("b", "product", "KLY", SIZES)) == [-1, 0]
    assert repeats(("a", "product", "Sofa Ek", SIZES), ("b", "product", "EK", SIZES)) == [-1, -1]


def test_a_source_has_at_most_two_hundred_rows_in_a_fit_and_a_suspected_package_none(tmp_path):
    rows = []
    for number in range(203):
        sizes = [900.0 + 3 * number, 600.0 + 2 * number, 500.0 + number]
        row = dict.fromkeys(ROWS.names) | {"node_id": "n", "pose": "any", "kind": "product", "title": "", "flags": []}
        row |= {"item_id": f"a:{number:03d}", "source": "a" if number < 201 else "b", "extents_mm": sizes}
        rows.append(row | {"hash": number, "source_id": str(number), "flags": [PACKAGE] if number == 202 else []})
    with pa.ipc.new_file(tmp_path / "ingest-0000000.arrow", ROWS) as writer:
        writer.write_batch(pa.RecordBatch.from_pylist(rows, schema=ROWS))
    unit = clean_unit(tmp_path, Unit(0, ("n",)), {}, {"n": None}, frozenset())
    assert unit.counts == {}
    (tmp_path / "clean-000-0000000.rows").write_bytes(unit.rows)
    [fit] = pickle.loads(shard_classes(tmp_path, 0, unit.n_by_evidence).rows)
    assert Counter(fit.sources) == {"a": MAX_FIT_ROWS, "b": 1}
    assert (MAX_FIT_ROWS, fit.n) == (200, 203)


def test_two_of_three_sizes_identify_no_product_of_two_shops():
    alpha = ("product", "alpha desk")
    assert repeats(("a", *alpha, SIZES), ("b", *alpha, SIZES)) == [-1, 0]
    assert repeats(("a", *alpha, SIZES[:2]), ("b", *alpha, SIZES[:2])) == [-1, -1]
    assert repeats(("a", *alpha, [850.0] * 3), ("b", *alpha, [850.0] * 3)) == [-1, -1]


def test_sizes_are_one_number_within_five_hundredths_of_a_per_cent():
    sizes = np.exp(np.linspace(0.0, 1.0, 20_001))
    assert len(np.unique(size_codes(sizes[:, None]))) == 2001
