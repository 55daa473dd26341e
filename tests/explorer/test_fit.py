"""Whether an object fits through or into another one: the rule, its reason, and what is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from explorer.catalogue import ReleaseCatalogue
from explorer.everyday_sizes import all_axes_text
from explorer.fit import MAX_SIDE_MM, MIN_SIDE_MM, fit_response, random_sizes, stated_sides
from explorer.schemas import FitQuery
from metric_base.errors import InputError


@pytest.mark.parametrize(
    ("text", "sides"),
    [
        ("210 x 95 x 85 cm", [2100.0, 950.0, 850.0]),
        ("80×200", [800.0, 2000.0]),
        ("1x2x3 in", [25.4, 50.8, 76.2]),
        ("sofa", None),
        ("210", None),
    ],
)
def test_sides_of_a_text(text: str, sides: list[float] | None) -> None:
    assert stated_sides(text) == (None if sides is None else pytest.approx(sides))


def test_sides_out_of_range_are_refused() -> None:
    assert stated_sides(f"{MIN_SIDE_MM} x {MAX_SIDE_MM:.0f} mm") == [MIN_SIDE_MM, MAX_SIDE_MM]
    for text in (f"{MIN_SIDE_MM / 2} x 1 mm", f"1 x {2 * MAX_SIDE_MM:.0f} mm"):
        with pytest.raises(InputError, match="sides: expected 0"):
            stated_sides(text)


@pytest.mark.parametrize(
    ("thing", "into", "how", "probability", "reason"),
    [
        ("95 x 210 x 85 cm", "90 x 200 cm", "through", 1.0, "shortest side"),
        ("95 x 210 x 91 cm", "90 x 200 cm", "through", 0.0, "shortest side"),
        ("205 x 210 x 85 cm", "90 x 200 cm", "through", 0.0, "middle side"),
        ("10 x 20 x 30 cm", "31 x 21 x 11 cm", "in", 1.0, "shortest side"),
        ("10 x 20 x 32 cm", "31 x 21 x 11 cm", "in", 0.0, "longest side"),
        ("10 x 20 cm", "31 x 21 x 11 cm", "in", None, "2 of the 3 necessary sides"),
    ],
)
def test_stated_sides_fit_or_not(
    catalogue: ReleaseCatalogue, thing: str, into: str, how: str, probability: float | None, reason: str
) -> None:
    answer = fit_response(catalogue, FitQuery(thing, into))
    assert (answer.how, answer.probability) == (how, probability)
    assert reason in answer.reason


def test_a_category_fits_with_the_probability_of_its_prior(catalogue: ReleaseCatalogue) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    prior = catalogue.prior(node)
    assert prior is not None
    drawn = random_sizes(prior, 1)
    assert np.allclose(
        np.quantile(np.log(drawn), [0.1, 0.5, 0.9], axis=0), np.log(prior.quantiles([0.1, 0.5, 0.9])), atol=0.01
    )
    assert np.allclose(np.corrcoef(np.log(drawn).T), np.corrcoef(np.log(prior.sample(20_000, 0)).T), atol=0.03)
    middle = float(np.median(np.sort(prior.sample(20_000, 0), axis=1)[:, 1]))
    answer = fit_response(catalogue, FitQuery("swivel chair", f"{middle:.1f} x 9000 mm"))
    shortest = np.sort(prior.sample(20_000, 0), axis=1)[:, 0]
    assert answer.probability == pytest.approx(float((shortest <= middle).mean()), abs=0.01)
    assert answer.nodes == [node.node_id, None]
    assert not answer.is_upper_bound
    inside = fit_response(catalogue, FitQuery("1 x 2 x 3 cm", "swivel chair"))
    assert inside.is_upper_bound
    assert inside.reason.endswith(
        "These are outer sides of swivel chair; its inside is smaller, so the true probability is lower."
    )
    assert not fit_response(catalogue, FitQuery("1 x 2 x 3 cm", "4 x 4 x 4 cm")).is_upper_bound
    assert fit_response(catalogue, FitQuery("swivel chair", "swivel chair", "in")).probability == pytest.approx(
        0.2, abs=0.2
    )


def test_a_category_with_one_dimension_has_no_answer(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    prior = catalogue.prior(catalogue.nodes["rat.n.01"])
    assert prior is not None
    height = prior.marginal(("height",))
    monkeypatch.setattr(ReleaseCatalogue, "prior", lambda *_: height)
    answer = fit_response(catalogue, FitQuery("rat", "1 x 1 m"))
    assert answer.probability is None
    assert answer.reason == "Not known: 1 of the 3 necessary sides of rat are known."


def test_people_call_the_axes_of_objects_with_a_front_otherwise(catalogue: ReleaseCatalogue) -> None:
    node = catalogue.nodes["rat.n.01"]
    sizes = {"length": 1990.0, "width": 932.0, "height": 842.0}
    assert all_axes_text(node, sizes) == "about 1.99 m long, 93.2 cm wide and 84.2 cm high"
    sofa = replace(node, node_id="seat.n.03")
    assert all_axes_text(sofa, sizes) == "about 1.99 m wide, 93.2 cm deep and 84.2 cm high"
    assert all_axes_text(node, {"height": 842.0}) == "about 84.2 cm high"
    bottle = replace(node, node_id="bottle.n.01")
    assert all_axes_text(bottle, sizes) == "about 1.99 m in diameter and 84.2 cm high"
    assert all_axes_text(bottle, {"width": 932.0}) == "about 93.2 cm in the smaller diameter"
    extents = {"extent1": 300.0, "extent2": 200.0, "extent3": 85.0}
    assert all_axes_text(node, extents) == "about 30.0 × 20.0 × 8.5 cm, the longest side first"
