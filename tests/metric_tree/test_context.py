"""Priors of a region and a year: exact where nothing is known, soft where something is, never surer than the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import metric_tree
from metric_base.errors import InputError
from metric_base.regions import COUNTRIES, REGIONS, country_of, region_of
from metric_tree.context import Context, ContextModel, Where, context_effect, where_of
from metric_tree.prior import Prior

MODEL = ContextModel(region=0.3, year=0.2, own=0.1, kin=0.5, years=12.0)
SHARED = np.array([[0.02, 0.01], [0.01, 0.03]])


def prior(*contexts: Context) -> Prior:
    means = np.log([[4000.0, 1500.0], [4800.0, 1900.0]])
    covariances = np.array([np.diag([0.003, 0.002])] * 2)
    parts = ("length", "height"), np.array([0.6, 0.4]), means, covariances, SHARED
    return Prior("car.n.01", *parts, 100, 3, {"measured": 1.0}, 0.0, contexts=contexts)


def context(source: str, region: str | None, year: float | None, offset: float = 0.1, sd: float = 0.01) -> Context:
    return Context(source, region, year, np.array([offset, offset]), np.full(2, sd**2))


SIZES = st.floats(-0.3, 0.3)
CONTEXTS = st.lists(
    st.builds(
        context,
        st.sampled_from("abc"),
        st.sampled_from([None, "world", "europe", "DE", "FR", "US", "IN"]),
        st.none() | st.floats(1950, 2026),
        SIZES,
        st.floats(0.002, 0.3),
    ),
    max_size=8,
)
WHERES = st.builds(Where, st.sampled_from([None, "europe", "DE", "US", "CN"]), st.none() | st.floats(1900, 2050))


@settings(max_examples=30)
@given(CONTEXTS, WHERES)
def test_what_is_known_narrows_b_and_never_beyond_what_other_sources_may_say(contexts, where) -> None:
    plain = prior(*contexts)
    there = plain.in_context(where, MODEL)
    before, after = np.diagonal(plain.shared_covariance), np.diagonal(there.shared_covariance)
    assert np.all(after <= before * (1 + 1e-9))
    assert np.all(after >= before * (1 - MODEL.region - MODEL.year) * (1 - 1e-9))
    assert np.all(np.linalg.eigvalsh(there.shared_covariance) >= -1e-12)
    assert there.covariances is plain.covariances
    if where.region is not None and any(one.region == where.region for one in contexts):
        assert np.all(after < before)


@settings(max_examples=20)
@given(CONTEXTS)
def test_a_year_far_from_all_that_is_known_gives_the_plain_prior(contexts) -> None:
    plain = prior(*contexts)
    there = plain.in_context(Where(year=1400), MODEL)
    np.testing.assert_allclose(there.means, plain.means)
    np.testing.assert_allclose(there.shared_covariance, plain.shared_covariance)


def test_what_is_known_of_a_region_moves_the_prior_and_explains_a_part_of_b() -> None:
    """Data of the very country, many sources: the centre moves most of the way, B loses the region's share."""
    plain = prior(*(context(name, "DE", 2011, 0.2, 0.002) for name in "abcdefgh"))
    there = plain.in_context(Where("DE", 2011), MODEL)
    effect = context_effect(plain.contexts, np.diagonal(SHARED), Where("DE", 2011), MODEL)
    assert np.all(there.means - plain.means > 0.05)
    np.testing.assert_allclose(there.shared_covariance, SHARED * effect.factor.mean(), rtol=0.05)
    assert np.all(np.diagonal(there.shared_covariance) < 0.9 * np.diagonal(SHARED))
    assert "length +" in str(there.note)


def test_registered_fleets_outrank_catalogues_and_are_interpolated_in_time() -> None:
    fleets = [context("car_fleet_context", "europe", year, by, 0.001) for year, by in ((2000, -0.1), (2022, 0.0))]
    catalogue, then = context("list", "europe", 2011, 0.1), Where("europe", 2011)
    assert np.all(context_effect([catalogue], np.diagonal(SHARED), then, MODEL).offset > 0.02)
    assert np.all(context_effect([*fleets, catalogue], np.diagonal(SHARED), then, MODEL).offset < -0.005)
    effect = context_effect(fleets, np.diagonal(SHARED), then, MODEL)
    assert effect.offset == pytest.approx([-0.05, -0.05], abs=0.02)
    known = context_effect(fleets, np.diagonal(SHARED), Where("europe", 2000), MODEL)
    assert np.all(known.factor < 1 - MODEL.region - MODEL.year)
    near, later, country, other = (
        prior(*fleets).in_context(where, MODEL).means[0, 0] - prior().means[0, 0]
        for where in (Where("europe", 2000), Where("europe", 2022), Where("DE", 2000), Where("US", 2000))
    )
    assert near == pytest.approx(-0.1, abs=0.02)
    assert abs(later) < 0.02
    assert near < country < other
    # a mean over a data set's boxes is as precise, and is no population
    boxes = [replace(one, source="boxes") for one in fleets]
    assert np.all(context_effect(boxes, np.diagonal(SHARED), Where("europe", 2000), MODEL).factor > 0.5)
    assert np.all(context_effect([*boxes, catalogue], np.diagonal(SHARED), then, MODEL).offset > -0.005)


def test_without_contexts_or_without_a_model_the_plain_prior_holds_and_the_note_says_so() -> None:
    for there in (
        prior().in_context(Where("europe"), MODEL),
        prior(context("a", "DE", 2011)).in_context(Where("europe"), None),
    ):
        np.testing.assert_array_equal(there.interval(0.9), prior().interval(0.9))
        assert "nothing known" in str(there.note)
        assert "the plain prior holds" in str(there.note)


def test_a_place_or_a_year_without_sources_says_what_is_known_instead() -> None:
    plain = prior(context("a", "DE", 2011, 0.3), context("b", "US", 1990, -0.2))
    there = plain.in_context(Where("JP"), MODEL)
    np.testing.assert_array_equal(there.means, plain.means)
    assert there.note == "JP: nothing known, so that the plain prior holds; known: DE, US, years from 1990 to 2011"
    assert "nothing known" not in str(plain.in_context(Where("FR"), MODEL).note)


def test_a_context_moves_the_right_way() -> None:
    """Where sources of a region or a year are larger, asking for it answers larger, and elsewhere smaller."""
    plain = prior(
        *(context(name, "US", 2020, 0.1) for name in "abc"), *(context(name, "europe", 1990, -0.1) for name in "def")
    )
    for asked, sign in (("usa", 1), ("germany", -1), ("2020", 1), ("1990", -1)):
        moved = plain.in_context(where_of(asked), MODEL).means - plain.means
        assert np.all(sign * moved > 0), asked


@pytest.mark.parametrize(
    ("text", "region", "year"),
    [
        ("usa", "US", None),
        ("germany", "DE", None),
        ("Ivory Coast, 1985", "CI", 1985),
        ("region=UK", "GB", None),
        ("2011", None, 2011),
        ("north america", "north-america", None),
    ],
)
def test_a_context_by_the_name_of_a_country(text: str, region: str | None, year: float | None) -> None:
    assert where_of(text) == Where(region, year)


def test_every_country_has_a_name_and_every_name_a_country() -> None:
    assert country_of("united states of america") == "US"
    assert country_of("Atlantis") is None
    assert {country_of(name) for name in ("Sweden", "côte d'ivoire", "south korea")} == {"SE", "CI", "KR"}


@given(SIZES)
def test_the_offset_goes_towards_what_was_seen_and_not_beyond(offset: float) -> None:
    effect = context_effect([context("a", "DE", 2010, offset)], np.diagonal(SHARED), Where("DE", 2010), MODEL)
    assert np.all(effect.offset * offset >= 0)
    assert np.all(np.abs(effect.offset) <= abs(offset) * (MODEL.region + MODEL.year) + 1e-9)


def test_nearer_places_and_years_and_more_sources_say_more() -> None:
    seen = [context("a", "DE", 2010)]
    asked = [Where("DE", 2010), Where("FR", 2010), Where("FR", 1990), Where("US", 1990)]
    offsets = [context_effect(seen, np.diagonal(SHARED), where, MODEL).offset[0] for where in asked]
    assert offsets == sorted(offsets, reverse=True)
    assert offsets[2] > 2 * offsets[3] > 0
    two = context_effect([*seen, context("b", "DE", 2011)], np.diagonal(SHARED), asked[0], MODEL)
    assert two.offset[0] > offsets[0]
    assert two.factor[0] < context_effect(seen, np.diagonal(SHARED), asked[0], MODEL).factor[0]


def test_the_world_is_no_place_of_its_own() -> None:
    assert where_of({"region": "world", "year": 2011}) == Where(None, 2011)
    seen = [context("a", "world", None)]
    assert context_effect(seen, np.diagonal(SHARED), Where("DE"), MODEL).offset[0] == 0


def test_a_marginal_keeps_the_contexts_of_its_axis() -> None:
    mixed = replace(context("a", "DE", 2010), offset=np.array([0.2, np.nan]))
    plain = prior(mixed)
    where = Where("DE", 2010)
    height, length = (plain.marginal(axis).in_context(where, MODEL) for axis in ("height", "length"))
    np.testing.assert_array_equal(height.means, plain.marginal("height").means)
    np.testing.assert_allclose(length.means[:, 0], plain.in_context(where, MODEL).means[:, 0])
    assert length.means[0, 0] > plain.means[0, 0]


@settings(max_examples=20)
@given(CONTEXTS)
def test_a_row_keeps_the_contexts(contexts) -> None:
    plain = prior(*contexts)
    again = Prior.of_row(plain.row())
    where = Where("DE", 2010)
    np.testing.assert_array_equal(again.in_context(where, MODEL).means, plain.in_context(where, MODEL).means)


@pytest.mark.parametrize("text", ["region=DE, year=2011", {"region": "de", "year": "2011"}, Where("DE", 2011)])
def test_a_context_is_read_from_a_text_or_a_mapping(text) -> None:
    assert where_of(text) == Where("DE", 2011)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ("region=Atlantis", "'Atlantis'"),
        ("year=later", "'later'"),
        ({"year": 20110}, "20110"),
        ("place=europe", "place"),
        ({}, "neither"),
    ],
)
def test_what_is_no_context_is_one_line(asked, says: str) -> None:
    with pytest.raises(InputError, match="expected") as error:
        where_of(asked)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_every_country_is_in_one_region() -> None:
    codes = [code for code in COUNTRIES if region_of(code) in REGIONS]
    assert len(codes) == len(COUNTRIES) == 248
    assert region_of("AQ") is None


def test_cars_of_a_continent_and_a_decade_lie_where_its_fleet_does() -> None:
    """Cars of the United States are longer than those of Germany, 4402 mm on average about 2019 (car_fleet_context)."""
    car = metric_tree.open().find("car")
    assert car.prior().contexts
    length = {
        place: car.prior(where=f"region={place},year=2019").marginal("length").quantile(0.5)[0]
        for place in ("US", "DE")
    }
    assert length["US"] > 1.02 * length["DE"]
