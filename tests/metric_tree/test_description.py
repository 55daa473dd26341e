from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import metric_tree
from metric_base.errors import InputError
from metric_tree.reports.description import (
    everyday_sentence,
    is_heterogeneous,
    item_quantiles,
    node_sentence,
    shipped_evidence,
    subject_and_verb,
)
from metric_tree.tree import Tree
from tests.synthetic.priors import prior as synthetic_prior


def test_the_sentence_gives_median_and_interval(mini: Tree) -> None:
    prior = mini.find("swivel chair").prior()
    sentence = everyday_sentence("swivel chair", prior)
    low, high = prior.interval(0.9)[prior.dims.index("height")] / 1000
    middle = prior.quantile(0.5)[prior.dims.index("height")] / 1000
    assert sentence == (f"A swivel chair is about {middle:.2g} m high; nine of ten are {low:.2g} to {high:.2g} m.")


def test_articles_of_all_names_of_the_shipped_release() -> None:
    """Names were read one by one; a new name that ends like those of materials or plurals is to be read, too."""
    subjects = {subject_and_verb(node.name.partition(" (")[0]) for node in metric_tree.open()}
    with_article = [one for one in subjects if re.match(r"An? (?!.* (?:of|with|on) )", one)]
    materials = [one for one in with_article if re.search(r"(?:wear|ware|cheese|juice|paper|milk|bread) is$", one)]
    assert materials == ["A newspaper is"]
    plurals = {one.split()[-2] for one in with_article if re.search(r"[^isu]s is$", one)}
    dogs = {"Flandres", "Pyrenees", "Norrbottenspets", "Schapendoes"}
    vases = {"kantharos", "kyathos", "lekythos", "skyphos", "stamnos", "aryballos", "askos"}
    assert plurals - dogs - vases == {
        "lens",
        "canvas",
        "hen-of-the-woods",
        "patas",
        "thermos",
        "triceratops",
        "rhinoceros",
    }
    vowels = "|".join(sorted(subjects))
    spoken = {"A Eurasier", "A euro", "A one", "An HTPC", "An MR16", "An F15", "An R14", "An R20", "An S14", "An ST19"}
    found = re.findall(r"\b(?:A [AEIOaeio][\w-]*|An [^AEIOUaeiou][\w-]*)", vowels)
    assert set(found) - spoken == {"An hourglass"}


def test_the_unit_follows_the_size(mini: Tree) -> None:
    assert " cm " in everyday_sentence("mouse", mini.find("mouse.n.04").prior(("height",)))
    assert everyday_sentence("apple", mini.find("swivel chair").prior(("length",))).startswith(
        "An apple is about 62 cm"
    )


def test_a_pair_of_one_object_is_plural(mini: Tree) -> None:
    prior = mini.find("swivel chair").prior(("length",))
    assert everyday_sentence("over-ear headphones", prior).startswith("Over-ear headphones are about 62 cm")
    assert everyday_sentence("bus", prior).startswith("A bus is")
    for name, subject in (
        ("street furniture", "Street furniture is"),
        ("chest of drawers", "A chest of drawers is"),
        ("scooters for adults", "Scooters for adults are"),
        ("LP record", "An LP record is"),
        ("USB stick", "A USB stick is"),
        ("hourglass", "An hourglass is"),
        ("LEGO brick", "A LEGO brick is"),
        ("one dollar coin", "A one dollar coin is"),
        ("uninterruptible power supply", "An uninterruptible power supply is"),
        ("unicycle", "A unicycle is"),
        ("brown rice", "Brown rice is"),
        ("brass knucks", "Brass knucks are"),
        ("jean", "Jeans are"),
        ("toiletry", "Toiletries are"),
        ("cottage cheese", "Cottage cheese is"),
        ("work on paper", "A work on paper is"),
        ("washing-up liquid", "Washing-up liquid is"),
        ("bubble gum", "Bubble gum is"),
        ("blue gum", "A blue gum is"),
        ("duct tape", "Duct tape is"),
        ("cassette tape", "A cassette tape is"),
        ("hardware", "Hardware is"),
        ("door and doorframe", "Objects of the category door and doorframe are"),
        ("Irish red and white setter", "An Irish red and white setter is"),
        ("MR16 bulb", "An MR16 bulb is"),
        ("utility knife", "A utility knife is"),
    ):
        assert everyday_sentence(name, prior).startswith(f"{subject} about")


@pytest.mark.parametrize(("name", "subject"), [("Euro pallet", "a Euro pallet"), ("AA battery", "an AA battery")])
def test_the_article_follows_the_sound_and_is_small_within_the_sentence(mini: Tree, name: str, subject: str) -> None:
    prior = replace(mini.find("swivel chair").prior(), tier="norm", norm="ISO 1, clause 2: any")
    assert everyday_sentence(name, prior).startswith(f"By ISO 1, clause 2: any: {subject} is about")


def test_evidence_counts_the_items_below(mini: Tree) -> None:
    chair = mini.find("chair")
    evidence = shipped_evidence(chair)
    assert sum(evidence["kind"].values()) == chair.items().num_rows == sum(evidence["licence"].values())


def test_quantiles_are_those_of_the_kind(mini: Tree) -> None:
    node = mini.find("swivel chair")
    (kind,) = shipped_evidence(node)["kind"]
    found = item_quantiles(node, kind, (0.5,))
    heights = np.array(node.items()["height_mm"].to_pylist(), dtype=float)
    assert found["n"] == heights.size
    assert found["quantiles_mm"]["height"]["0.5"] == pytest.approx(np.median(heights), abs=0.01)


@pytest.mark.parametrize(("kind", "expected"), [("heirloom", "one of measured, "), ("museum", "a kind that swivel_")])
def test_a_kind_without_items_is_refused(mini: Tree, kind: str, expected: str) -> None:
    with pytest.raises(InputError, match=f"--kind: expected {expected}"):
        item_quantiles(mini.find("swivel chair"), kind, (0.5,))


def test_a_mixed_node_names_its_children_in_place_of_a_number() -> None:
    tree = metric_tree.open()
    vehicle, mug = tree.find("vehicle"), tree.find("mug")
    sentence = node_sentence(vehicle, "vehicle", vehicle.prior())
    assert sentence.startswith("Vehicle: mixed, ")
    assert "car" in sentence
    assert not is_heterogeneous(mug, mug.prior())
    assert "high" in node_sentence(mug, "mug", mug.prior())


def test_a_node_is_mixed_if_its_interval_exceeds_tenfold(mini: Tree) -> None:
    chair = mini.find("chair")
    for ratio, is_mixed in ((9.9, False), (10.1, True)):
        sd = np.log(ratio) / (2 * 1.6449)
        prior = synthetic_prior("chair.n.01", [[600.0, 500.0, 900.0]], spread=sd, shared=0.0)
        assert is_heterogeneous(chair, prior) == is_mixed
        assert not is_heterogeneous(mini.find("swivel chair"), prior)


def test_the_height_is_the_main_axis_from_a_quarter_of_the_longest() -> None:
    for height, word in ((240.0, "long"), (260.0, "high")):
        assert word in everyday_sentence("crate", synthetic_prior("crate", [[1000.0, 500.0, height]]))


def test_sizes_have_units_from_two_centimetres_and_one_metre_and_four_digits_if_they_are_narrow() -> None:
    for size, unit in ((19.0, "mm"), (21.0, "cm"), (990.0, "cm"), (1010.0, "m")):
        assert f" {unit} high" in everyday_sentence("crate", synthetic_prior("crate", [[size, size, size]]))
    for ratio, has_four_digits in ((1.09, True), (1.11, False)):
        sd = np.log(ratio) / (2 * 1.6449)
        sentence = everyday_sentence("crate", synthetic_prior("crate", [[200.0, 200.0, 1234.0]], spread=sd, shared=0.0))
        assert ("1.234 m" in sentence) == has_four_digits


@pytest.mark.parametrize(
    ("sizes", "spread", "text"),
    [
        ([1000.0, 500.0, 260.0], 0.1, "about 26 cm high"),  # MIN_HEIGHT_FRACTION of 0.25
        ([1000.0, 500.0, 240.0], 0.1, "about 100 cm long"),
        ([10.0, 10.0, 19.0], 0.1, "about 19 mm high"),  # CM_FROM_MM and M_FROM_MM
        ([10.0, 10.0, 21.0], 0.1, "about 2.1 cm high"),
        ([400.0, 400.0, 990.0], 0.1, "about 99 cm high"),
        ([400.0, 400.0, 1010.0], 0.1, "about 1 m high"),
        ([400.0, 400.0, 765.4], 0.0285, "about 76.54 cm high"),  # NARROW_RATIO of 1.1 over 3.29 deviations
        ([400.0, 400.0, 765.4], 0.0295, "about 77 cm high"),
    ],
)
def test_axis_unit_and_digits_of_a_sentence(sizes: list[float], spread: float, text: str) -> None:
    assert text in everyday_sentence("thing", synthetic_prior("thing", [sizes], spread, shared=1e-6))


@pytest.mark.parametrize(("n", "end"), [(8, "c6, c7."), (9, "c6, c7 and 1 more.")])
def test_a_mixed_node_names_at_most_eight_children(n: int, end: str) -> None:
    children = tuple(SimpleNamespace(name=f"c{k} (x)", n_items=9 - k) for k in range(n))
    wide = synthetic_prior("a", [[600.0, 500.0, 900.0]], spread=1.0)
    node: Any = SimpleNamespace(children=children)
    assert node_sentence(node, "vehicle", wide).endswith(f"ask for one of c0, c1, c2, c3, c4, c5, {end}")
