"""Compare the held-out density of our priors with other mixtures: `python -m benchmarks.metric_tree.priors RAW...`.

Each source is held out in turn (`leave_source_out`), and its complete rows are scored by the mean log density over
ln mm. A density over mm is converted by its Jacobian, + sum ln x. `ours` is the prior of a build without the source,
and `within` the same without the covariance between sources. The others are fitted to the complete rows of the class:
`authors` is `BayesianGaussianMixture(n // 3)` in mm, as in the paper's code; `bic` is a `GaussianMixture` of one to
four components over ln mm, selected by BIC. Classes with two equal sizes in more than 30 % of the rows are skipped,
because their density is unbounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.common import print_rows
from benchmarks.metric_tree.leave_source_out import SEED, Rows, held_rows, rows_parser, scored_sources
from metric_base.arrays import FloatArray
from metric_tree.fit.rows import STRONG

METHODS = ("ours", "within", "authors", "bic")
#: Minimum and maximum number of complete rows of a class for a fit.
MIN_CLASS_ROWS = 30
MAX_CLASS_ROWS = 120
#: Minimum number of complete rows of the held-out source.
MIN_SOURCE_ROWS = 8
#: Maximum fraction of rows with equal length and width.
MAX_ROUND_FRACTION = 0.3


def main() -> None:
    """Print the mean and median log density of each method, and the number of fits in which ours is better."""
    build = Rows.of(rows_parser(__doc__).parse_args())
    table = np.array(list(_scores(build)))
    print(f"{len(table)} pairs of a class and a source")
    figures = (table.mean(axis=0), np.median(table, axis=0), (table[:, :1] > table).sum(axis=0))
    print_rows(
        ["way", "mean", "median", "ours better in"],
        (
            (name, f"{mean:.2f}", f"{median:.2f}", wins)
            for name, mean, median, wins in zip(METHODS, *figures, strict=True)
        ),
    )


def _scores(build: Rows) -> Iterator[list[float]]:
    """Yield the mean log density of each method, for each pair of a class and a source with enough rows."""
    generator = np.random.default_rng(SEED)
    for source in scored_sources(build):
        for rows, prior in build.without(source):
            held = _complete(held_rows(rows, source))
            real = sorted({name for name, kind in zip(rows.sources, rows.kinds, strict=True) if kind in STRONG})
            seen = np.concatenate([_complete(held_rows(rows, name)) for name in real if name != source] or [held[:0]])
            if len(held) < MIN_SOURCE_ROWS or len(seen) < MIN_CLASS_ROWS or len(prior.dims) < 3 or prior.tier == "norm":
                continue
            if (np.abs(np.log(seen[:, 0] / seen[:, 1])) < 1e-3).mean() > MAX_ROUND_FRACTION:
                continue
            seen = generator.permutation(seen)[:MAX_CLASS_ROWS]
            within = replace(prior, shared_covariance=0 * prior.shared_covariance)
            columns = [rows.axes.index(dim) for dim in prior.dims]
            densities = (
                prior.log_density(held[:, columns]),
                within.log_density(held[:, columns]),
                _authors(seen).score_samples(held) + np.log(held).sum(axis=1),
                _by_bic(np.log(seen)).score_samples(np.log(held)),
            )
            yield [float(density.mean()) for density in densities]


def _complete(sizes: FloatArray) -> FloatArray:
    return sizes[~np.isnan(sizes).any(axis=1)]


def _authors(sizes: FloatArray) -> Any:
    from sklearn.mixture import BayesianGaussianMixture

    return _regularised(BayesianGaussianMixture, sizes, n_components=max(len(sizes) // 3, 1), random_state=SEED)


def _regularised(kind: Any, sizes: FloatArray, **options: Any) -> Any:
    """Fit with scikit-learn's default regularisation, and with ten times more whenever the Cholesky factor fails."""
    for power in range(-6, 3):
        try:
            return kind(reg_covar=10.0**power, **options).fit(sizes)
        except ValueError:
            continue
    raise ValueError(f"no fit of {len(sizes)} rows")


def _by_bic(sizes: FloatArray) -> Any:
    from sklearn.mixture import GaussianMixture

    fits = [_regularised(GaussianMixture, sizes, n_components=k, random_state=SEED, n_init=2) for k in range(1, 5)]
    return min(fits, key=lambda fit: fit.bic(sizes))


if __name__ == "__main__":
    main()
