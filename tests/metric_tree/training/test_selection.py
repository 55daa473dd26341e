"""The choice of categories: each figure against a closed form, the rules one by one, the command."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.posterior.shared_error import shared_error as estimators_error
from metric_cli.subcommands import main
from metric_tree.prior import Prior
from metric_tree.training.selection import (
    CategoryCandidate,
    Rules,
    candidates,
    choose,
    divergence,
    narrowing,
    paper_selection,
    reason_against,
)
from metric_tree.tree import Tree

AXES = ("length", "width", "height")


def _prior(sd: float, shared: float, components: int = 1, apart: float = 0.0, dims: tuple[str, ...] = AXES) -> Prior:
    d = len(dims)
    means = np.log(500.0) + apart * np.arange(components)[:, None] * np.ones(d)
    return Prior(
        "made.n.01", dims, np.full(components, 1 / components), means, np.tile(sd**2 * np.eye(d), (components, 1, 1)),
        shared**2 * np.eye(d), 100, 3, {"product": 1.0}, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(("sd", "shared"), [(0.05, 0.04), (0.2, 0.1), (0.4, 0.3)])
def test_narrowing_of_one_gaussian_has_a_closed_form(sd: float, shared: float) -> None:
    variance = (sd**2 + shared**2 + 0.06**2) / 3  # three independent looks at the same u
    exact = math.log(math.log(1000)) - 0.5 * math.log(2 * math.pi * math.e * variance)
    assert narrowing(_prior(sd, shared)) == pytest.approx(exact, abs=0.01)


def test_two_far_modes_of_one_shape_cost_a_bit() -> None:
    one, two = narrowing(_prior(0.1, 0.05)), narrowing(_prior(0.1, 0.05, components=2, apart=1.5))
    assert one - two == pytest.approx(math.log(2), abs=0.02)


def test_proportions_that_tell_modes_apart_cost_nothing() -> None:
    two = _prior(0.1, 0.05, components=2)
    told = replace(two, means=two.means + np.array([[0, 0, 0], [1.5, 1.5, 0.0]]))
    assert narrowing(told) == pytest.approx(narrowing(_prior(0.1, 0.05)), abs=0.05)


def test_noise_and_disagreement_only_take_away() -> None:
    assert narrowing(_prior(0.1, 0.05), noise=0.2) < narrowing(_prior(0.1, 0.05))
    assert narrowing(_prior(0.1, 0.3)) < narrowing(_prior(0.1, 0.05))


@pytest.mark.parametrize("shared", [0.0, 0.01, 0.05, 0.2])
@pytest.mark.parametrize("dims", [AXES, ("height",)])
def test_the_shared_error_is_the_estimators(shared: float, dims: tuple[str, ...]) -> None:
    prior = _prior(0.1, shared, dims=dims)
    axes = [AXES.index(name) for name in dims]
    assert np.allclose(prior.disagreement(), estimators_error(prior).covariance[np.ix_(axes, axes)])


def test_divergence_is_the_spread_of_log_size() -> None:
    assert divergence(_prior(0.3, 0.4)) == pytest.approx(0.5)
    drawn = np.log(_prior(0.1, 0.05, components=3, apart=0.7).sample(200_000, 1)).std(axis=0)
    assert divergence(_prior(0.1, 0.05, components=3, apart=0.7)) == pytest.approx(float(drawn.mean()), rel=0.01)


def _candidate(
    tree: Tree, name: str, narrows: float, lists: int = 4, samples: int = 100, sources: int = 3
) -> CategoryCandidate:
    prior = replace(_prior(0.1, 0.05), n=samples, n_sources=sources)
    return CategoryCandidate(tree.node(name), prior, divergence(prior), tuple("abcd"[:lists]), narrows, 0.1)


def test_each_rule_excludes_and_says_so(mini: Tree) -> None:
    mouse = _candidate(mini, "mouse.n.04", 2.0)
    rat = _candidate(mini, "rat.n.01", 3.0)
    cases = [
        (replace(rat, divergence=0.9), "divergence 0.90"),
        (_candidate(mini, "rat.n.01", 3.0, samples=19), "19 samples"),
        (_candidate(mini, "rat.n.01", 3.0, sources=1), "1 sources"),
        (_candidate(mini, "rat.n.01", 3.0, lists=1), "1 of 4"),
    ]
    assert choose([mouse, rat]) == [rat, mouse]
    for unfit, said in cases:
        taken = choose([mouse, unfit])
        assert taken == [mouse]
        assert said in str(reason_against(unfit, taken))
    one = Rules(count=1)
    assert "2.00 nats" in str(reason_against(mouse, choose([mouse, rat], one), one))
    assert reason_against(rat, [rat]) is None


def test_of_two_in_one_line_more_training_sets_win(mini: Tree) -> None:
    chair, swivel = _candidate(mini, "chair.n.01", 1.0), _candidate(mini, "swivel_chair.n.01", 3.0, lists=2)
    assert choose([swivel, chair]) == [chair]
    assert "chair" in str(reason_against(swivel, [chair]))
    alike = replace(swivel, lists=chair.lists)
    assert choose([alike, chair]) == [alike]


def test_candidates_are_what_training_sets_name(mini: Tree) -> None:
    found = {one.node.node_id: one for one in candidates(mini)}
    assert "mouse.n.04" in found  # COCO's mouse is the device
    assert "entity.n.01" not in found
    assert "coco_80" in found["mouse.n.04"].lists
    order = [one.narrowing for one in candidates(mini)]
    assert order == sorted(order, reverse=True)


def test_the_papers_are_forty_three() -> None:
    labels, nodes = zip(*paper_selection(), strict=True)
    assert len(set(labels)) == len(set(nodes)) == 43


def test_the_command_prints_and_writes(mini: Tree, tmp_path: Path, shown) -> None:
    out = tmp_path / "chosen.csv"
    words = ["select", "--tree", str(mini.release.directory), "--least-samples", "5", "--least-sources", "1"]
    status, found = shown(*words, "--out", str(out))
    assert status == 0
    assert found["schema"] == "metric-tree/select/1"
    assert "mouse.n.04" in {row["node"] for row in found["chosen"]}
    assert len(found["paper"]) == 43
    assert {row["reason"] for row in found["paper"] if not row["chosen"]} >= {"no prior in this release"}
    with out.open(encoding="utf-8") as file:
        assert [row["node"] for row in csv.DictReader(file)] == [row["node"] for row in found["chosen"]]
    assert main([*words, "--count", "0"]) == 2


def test_each_rule_has_its_figure(mini: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["select", "--tree", str(mini.release.directory), "--least-samples", "5", "--least-sources", "1"]
    file = tmp_path / "figures" / "rules.svg"
    assert main([*words, "--figure", str(file)]) == 0
    drawn = file.read_text(encoding="utf-8")  # matplotlib writes each text in a comment next to its outlines
    for label in ("divergence: sd of log size", "samples: items of the fit", "training data: of 4", "ours (orange"):
        assert label in drawn
    assert [path.name for path in file.parent.iterdir()] == ["rules.svg"]
    capsys.readouterr()
    assert main([*words, "--figure", str(tmp_path / "rules.txt")]) == 2
    assert "--figure: expected a name that ends in .png" in capsys.readouterr().err


def test_a_person_reads_a_table(mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["select", "--tree", str(mini.release.directory), "--least-samples", "5", "--least-sources", "1"]) == 0
    out = capsys.readouterr().out
    assert "mouse" in out.split()
    assert "no prior in this release" in out


def test_the_thresholds_of_the_rules(mini: Tree) -> None:
    rat = _candidate(mini, "rat.n.01", 3.0, lists=2, samples=20, sources=2)
    limits = [
        (replace(rat, divergence=0.5), replace(rat, divergence=0.51)),
        (rat, _candidate(mini, "rat.n.01", 3.0, lists=2, samples=19, sources=2)),
        (rat, _candidate(mini, "rat.n.01", 3.0, lists=2, samples=20, sources=1)),
        (rat, _candidate(mini, "rat.n.01", 3.0, lists=1, samples=20, sources=2)),
    ]
    for fit, unfit in limits:
        assert (choose([fit]), choose([unfit])) == ([fit], [])
