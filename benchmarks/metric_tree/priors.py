"""Held-out log density of priors.

`python -m benchmarks.metric_tree.priors RAW... [--work DIR] [--rows 150] [--classes 40]`.

Every way is fitted to the same rows of a class and scored on rows that it did not see, as the mean log density over
ln mm of rows that state length, width and height. A density over mm is brought to ln mm by its Jacobian, + sum ln x.

- `ours`: `metric_tree.fit.class_prior.class_prior`, which also takes rows with missing axes; its density is that of
  an object of
  unknown source (within + between); `within` is the same without the covariance between sources;
- `authors`: `BayesianGaussianMixture(n // 3)` in mm, the recipe of the released code;
- `bic-mm`, `bic-log`: `GaussianMixture` of one to four components by BIC, in mm and in ln mm.

First by cross-validation within a class, then across sources: fitted without a source, scored on it.
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.metric_tree.leave_source_out import SEED, WORKERS, clean_rows
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES
from metric_tree.fit.class_prior import class_prior
from metric_tree.fit.class_rows import ClassRows, take_rows
from metric_tree.fit.evidence import KIND_WEIGHT
from metric_tree.fit.kinds import KindModel, learn_kinds
from metric_tree.fit.moments import VAGUE, moments

WAYS = ("ours", "within", "authors", "bic-mm", "bic-log")

#: Complete rows that a class must have to be scored, and a source to be left out.
CLASS_ROWS, SOURCE_ROWS = 30, 8

FOLDS = 5

#: Classes with more rows than this whose length is their width are passed over.
ROUND_SHARE = 0.3


def main() -> None:
    arguments = _arguments()
    classes = list(_classes(arguments))
    known = (("", one) for rows in classes if (one := moments(rows).disagreement) is not None)
    model = learn_kinds(known, sorted(KIND_WEIGHT))
    print(f"{len(classes)} classes with {CLASS_ROWS} complete rows or more; {model}")
    chosen = np.random.default_rng(SEED).permutation(len(classes))[: arguments.classes]
    calls = [classes[number] for number in sorted(chosen)]
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        within = list(pool.map(partial(_cross_validated, model=model, rows=arguments.rows, seed=SEED), calls))
        _print("cross-validation within a class", dict(zip((c.node_id for c in calls), within, strict=True)))
        left = list(pool.map(partial(_across_sources, model=model, rows=arguments.rows, seed=SEED), calls))
    across = {
        f"{call.node_id} without {name}": scores
        for call, found in zip(calls, left, strict=True)
        for name, scores in found
    }
    _print("across sources", across)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("raw", nargs="+", type=Path)
    parser.add_argument("--work", type=Path, help="folder for the cleaned rows; taken up where they are there")
    parser.add_argument("--rows", type=int, default=150, help="rows of a class that take part (default: %(default)s)")
    parser.add_argument("--classes", type=int, default=40, help="classes drawn (default: %(default)s)")
    return parser.parse_args()


def _classes(arguments: argparse.Namespace) -> Iterator[ClassRows]:
    """Classes with enough complete rows of real objects, as the build cleans them."""
    work = arguments.work or Path(tempfile.mkdtemp())
    clean_rows(arguments.raw, work)
    for path in sorted(work.glob("clean-*.classes")):
        for one in pickle.loads(path.read_bytes()):  # noqa: S301 - written by this very program
            real = np.flatnonzero(~np.isin(one.kinds, ["judged", "norm"]))
            one = _chosen_rows(one, real)  # noqa: PLW2901 - a class without its range
            if one.axes == AXES and _complete(one).sum() >= CLASS_ROWS and not _is_round(one):
                yield one


def _is_round(one: ClassRows) -> bool:
    """Whether two sizes are equal in most rows (trees, coins: one diameter): a density without a floor is unbounded."""
    sizes = one.x[np.searchsorted(one.owner, np.flatnonzero(_complete(one)))]
    return bool((np.abs(sizes[:, 0] - sizes[:, 1]) < 1e-3).mean() > ROUND_SHARE)


def _complete(one: ClassRows) -> NDArray[np.bool_]:
    """Rows of one reading that state all axes."""
    readings = np.bincount(one.owner, minlength=len(one.sources))
    first = np.searchsorted(one.owner, np.arange(len(one.sources)))
    whole: NDArray[np.bool_] = (readings == 1) & ~np.isnan(one.x[first]).any(axis=1)
    return whole


def _chosen_rows(one: ClassRows, rows: NDArray[np.intp]) -> ClassRows:
    """The class with the given rows (m,), ascending, and as many items."""
    return replace(take_rows(one, rows), n=len(rows))


def _cross_validated(one: ClassRows, model: KindModel, rows: int, seed: int) -> dict[str, float]:
    generator = np.random.default_rng(seed)
    one = _chosen_rows(one, np.sort(generator.permutation(len(one.sources))[:rows]))
    fold = generator.permutation(len(one.sources)) % FOLDS
    whole = _complete(one)
    total = dict.fromkeys(WAYS, 0.0)
    for held in range(FOLDS):
        scores = _scores(one, np.flatnonzero(fold != held), np.flatnonzero((fold == held) & whole), model, seed)
        total = {way: total[way] + scores[way].sum() for way in WAYS}
    return {way: total[way] / max(int(whole.sum()), 1) for way in WAYS}


def _across_sources(one: ClassRows, model: KindModel, rows: int, seed: int) -> list[tuple[str, dict[str, float]]]:
    generator = np.random.default_rng(seed)
    names, whole = np.asarray(one.sources), _complete(one)
    found = []
    for name in sorted(set(one.sources)):
        held, seen = np.flatnonzero((names == name) & whole), np.flatnonzero(names != name)
        seen = np.sort(generator.permutation(seen)[:rows])
        if len(held) >= SOURCE_ROWS and whole[seen].sum() >= CLASS_ROWS:
            scores = _scores(one, seen, generator.permutation(held)[:rows], model, seed)
            found.append((name, {way: float(scores[way].mean()) for way in WAYS}))
    return found


def _scores(
    one: ClassRows, seen: NDArray[np.intp], held: NDArray[np.intp], model: KindModel, seed: int
) -> Mapping[str, FloatArray]:
    """Log densities over ln mm of the rows `held` under each way's fit to the rows `seen`."""
    first = np.searchsorted(one.owner, np.arange(len(one.sources)))
    test = one.x[first[held]]
    whole = _complete(one)
    train = one.x[first[seen[whole[seen]]]]
    prior = class_prior(_chosen_rows(one, seen), VAGUE, model, seed=seed, heldout=False)
    alone = replace(prior, shared_covariance=0 * prior.shared_covariance)
    jacobian = test.sum(axis=1)
    return {
        "ours": prior.log_density(np.exp(test)),
        "within": alone.log_density(np.exp(test)),
        "authors": _authors(np.exp(train), seed).score_samples(np.exp(test)) + jacobian,
        "bic-mm": _by_bic(np.exp(train), seed).score_samples(np.exp(test)) + jacobian,
        "bic-log": _by_bic(train, seed).score_samples(test),
    }


def _authors(sizes: FloatArray, seed: int) -> Any:
    from sklearn.mixture import BayesianGaussianMixture

    return _regularised(BayesianGaussianMixture, sizes, n_components=max(len(sizes) // 3, 1), random_state=seed)


def _regularised(kind: Any, sizes: FloatArray, **options: Any) -> Any:
    """The fit with scikit-learn's own regularisation, ten times that as often as its Cholesky factor fails."""
    for power in range(-6, 3):
        try:
            return kind(reg_covar=10.0**power, **options).fit(sizes)
        except ValueError:
            continue
    raise ValueError(f"no fit of {len(sizes)} rows")


def _by_bic(sizes: FloatArray, seed: int) -> Any:
    from sklearn.mixture import GaussianMixture

    fits = [_regularised(GaussianMixture, sizes, n_components=k, random_state=seed, n_init=2) for k in range(1, 5)]
    return min(fits, key=lambda fit: fit.bic(sizes))


def _print(title: str, scores: Mapping[str, Mapping[str, float]]) -> None:
    table = np.array([[found[way] for way in WAYS] for found in scores.values()])
    print(f"\n{title}: {len(table)} fits, mean log density over ln mm")
    print(f"{'':44}" + "".join(f"{way:>9}" for way in WAYS))
    for name, row in zip(scores, table, strict=True):
        print(f"{name:44.44}" + "".join(f"{value:9.2f}" for value in row))
    for name, row in (("mean", table.mean(axis=0)), ("median", np.median(table, axis=0))):
        print(f"{name:44}" + "".join(f"{value:9.2f}" for value in row))
    wins = (table[:, :1] > table).sum(axis=0)
    print(f"{'classes in which ours is better':44}" + "".join(f"{value:9d}" for value in wins))


if __name__ == "__main__":
    main()
