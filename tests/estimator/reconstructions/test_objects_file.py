"""The reader of `metric-tree/objects/1`: accepted records, and one clear line for each error."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.reconstructions.objects_file import SCHEMA, parse_objects, read_objects
from metric_base.errors import InputError

# Published values, written out so that a changed rule fails a test.
DEFAULT_SIGMA = 0.05

CAR: dict[str, Any] = {
    "id": "car-3",
    "category": "car",
    "score": 0.98,
    "dimensions": {"length": 0.412, "width": 0.171, "height": 0.150},
    "confidence": {"length": 0.9},
    "truncated": ["length"],
}


def _document(*objects: object) -> dict[str, Any]:
    return {"schema": SCHEMA, "objects": list(objects)}


def _read(tmp_path: Path, document: object) -> Any:
    path = tmp_path / "objects.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return read_objects(path)


def test_the_contract_example(tmp_path: Path) -> None:
    (car,) = _read(tmp_path, _document(CAR))
    assert (car.id, car.category, car.score, car.vertical_known) == ("car-3", "car", 0.98, True)
    assert car.extents.tolist() == [0.412, 0.171, 0.150]
    assert car.truncated.tolist() == [True, False, False]
    assert car.confidence[0] == 0.9
    assert math.isnan(car.confidence[1])
    assert car.sigma.tolist() == [DEFAULT_SIGMA] * 3


def test_the_example_of_the_documentation(tmp_path: Path) -> None:
    text = (Path(__file__).parents[3] / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
    example = text.partition("\n## Objects\n")[2].partition("```json")[2].partition("```")[0]
    car, chair = _read(tmp_path, json.loads(example))
    assert (car.id, car.truncated.tolist(), car.sigma.tolist()) == ("car-3", [True, False, False], [0.05, 0.05, 0.03])
    assert (chair.id, chair.vertical_known) == ("1", False)


def test_what_is_optional(tmp_path: Path) -> None:
    first, second = _read(
        tmp_path,
        _document({"category": "cup", "dimensions": {"height": 2}}, {"category": "x", "extents": [3, 1]}),
    )
    assert math.isnan(first.extents[0])
    assert first.extents[2] == 2
    assert not second.vertical_known
    assert second.extents[:2].tolist() == [3, 1]
    assert math.isnan(second.extents[2])
    assert first.id != second.id


def test_low_confidence_is_a_cut(tmp_path: Path) -> None:
    """The paper's threshold: a side of eta under 0.7 is not trusted."""
    (car,) = _read(
        tmp_path, _document(CAR | {"confidence": {"height": 0.69, "width": 0.7, "length": 0.71}, "truncated": []})
    )
    assert car.truncated.tolist() == [False, False, True]


def test_width_longer_than_length_is_exchanged(tmp_path: Path) -> None:
    sizes = {"length": 1, "width": 2, "height": 3}
    (item,) = _read(tmp_path, _document({"category": "x", "dimensions": sizes, "truncated": ["width"]}))
    assert item.extents.tolist() == [2, 1, 3]
    assert item.truncated.tolist() == [True, False, False]
    assert item.notes


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ([], "document: expected an object"),
        (
            {"schema": "metric-tree/objects/2", "objects": []},
            "schema: expected metric-tree/objects/1, found 'metric-tree/objects/2'",
        ),
        ({"schema": SCHEMA}, "objects: expected an array"),
        (_document(3), r"objects\[0\]: expected an object"),
        (_document({"dimensions": {"height": 1}}), r"objects\[0\].category: expected a name"),
        (_document({"category": "x"}), "expected dimensions or extents"),
        (_document(CAR | {"dimensions": {"depth": 1}}), "expected some of length, width, height, found 'depth'"),
        (_document(CAR | {"dimensions": {"height": 0}}), r"dimensions.height: expected a positive number, found 0"),
        (_document(CAR | {"dimensions": {"height": "1"}}), "expected a positive number"),
        (_document(CAR | {"dimensions": {"height": True}}), "expected a positive number"),
        (_document(CAR | {"dimensions": {"height": 10**400}}), "expected a positive number"),
        (_document(CAR | {"sigma": {"height": math.nan}}), "sigma.height: expected a positive number"),
        (_document(CAR | {"dimensions": [1, 2, 3]}), "dimensions: expected an object"),
        (_document(CAR | {"score": 1.5}), "score: expected a number from 0 to 1"),
        (_document(CAR | {"truncated": "length"}), "truncated: expected an array"),
        (_document(CAR | {"truncated": ["depth"]}), r"truncated\[0\]: expected some of length"),
        (_document(CAR | {"confidence": {"length": -1}}), "confidence.length"),
        (_document({"category": "x", "extents": [1, 2]}), "expected the longest first"),
        (_document({"category": "x", "extents": []}), "expected one to three lengths"),
        (_document({"category": "x", "extents": [4, 3, 2, 1]}), "expected one to three lengths"),
        (_document(CAR, CAR), r"objects\[1\].id: expected a unique id"),
        (_document(CAR | {"id": {}}), "id: expected text or a number"),
    ],
)
def test_one_clear_line(tmp_path: Path, document: object, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        _read(tmp_path, document)
    assert "\n" not in str(error.value)
    assert str(tmp_path / "objects.json") in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "NaN",
        '{"schema": "metric-tree/objects/1", "objects": [{"category": "x", "extents": [NaN]}]}',
        "[" * 100_000,
    ],
)
def test_damaged_text(tmp_path: Path, text: str) -> None:
    path = tmp_path / "objects.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError):
        read_objects(path)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=3,
)
_ENTRY = st.fixed_dictionaries(
    {},
    optional={
        "id": _JSON,
        "category": st.just("car") | _JSON,
        "dimensions": st.dictionaries(st.sampled_from(["length", "width", "height"]), _JSON) | _JSON,
        "extents": st.lists(_JSON, max_size=4) | _JSON,
        "score": _JSON,
        "confidence": _JSON,
        "truncated": _JSON,
        "sigma": _JSON,
    },
)


@given(st.lists(_ENTRY, min_size=1, max_size=2))
@settings(max_examples=100, deadline=None)
def test_any_json_is_read_or_refused(entries: list[Any]) -> None:
    """Whatever stands there: objects with positive finite extents, or `InputError`; never another exception."""
    try:
        objects = parse_objects(Path("x.json"), _document(*entries))
    except InputError:
        return
    for item in objects:
        sizes = item.extents[~(item.extents != item.extents)]
        assert (sizes > 0).all()
        assert (sizes < math.inf).all()
        assert 0 <= item.score <= 1


@pytest.mark.parametrize(("n", "message"), [(50_000, r"objects\[0\]"), (50_001, "at most 50,000, found 50001")])
def test_a_file_has_at_most_50000_objects(n: int, message: str) -> None:
    with pytest.raises(InputError, match=message):  # the first object of the permitted number has no category
        parse_objects(Path("objects.json"), _document(*[{}] * n))
