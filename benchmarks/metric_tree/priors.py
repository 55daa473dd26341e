"""Held-out density of our priors and of mixtures fitted as others do: `python -m benchmarks.metric_tree.priors RAW...`.

Each source is left out in turn (`leave_source_out`), and its complete rows are scored: mean log density over ln mm. A
density over mm is brought to ln mm by its Jacobian, + sum ln x. `ours` is the prior that a build without the source
would publish; `within` the same without the covariance between sources; the others are fitted to the complete rows of
the class: `authors`, `BayesianGaussianMixture(n // 3)` in mm, the recipe of the released code; `bic`, `GaussianMixture`
of one to four components by BIC over ln mm. Classes of which most rows have two equal sizes are left out: without a
floor their density is unbounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.common import print_rows
from benchmarks.metric_tree.leave_source_out import SEED, Rows, held_rows, left_out, rows_parser
from metric_base.arrays import FloatArray
from metric_tree.fit.rows import STRONG

WAYS = ("ours", "within", "authors", "bic")
#: Complete rows of a class that are fitted, and of a source that are scored.
CLASS_ROWS, MOST_ROWS, SOURCE_ROWS = 30, 120, 8
#: Share of rows with two equal sizes.
ROUND_SHARE = 0.3


def main() -> None:
    """Print mean and median of each way, and in how many fits ours is better."""
    build = Rows.of(rows_parser(__doc__).parse_args())
    table = np.array(list(_scores(build)))
    print(f"{len(table)} pairs of a class and a source")
    figures = (table.mean(axis=0), np.median(table, axis=0), (table[:, :1] > table).sum(axis=0))
    print_rows(
        ["way", "mean", "median", "ours better in"],
        ((way, f"{mean:.2f}", f"{median:.2f}", wins) for way, mean, median, wins in zip(WAYS, *figures, strict=True)),
    )


def _scores(build: Rows) -> Iterator[list[float]]:
    """Of each pair of a class and a source with enough rows, the log density under each way."""
    generator = np.random.default_rng(SEED)
    for source in left_out(build):
        for rows, prior in build.without(source):
            held = _whole(held_rows(rows, source))
            real = sorted({name for name, kind in zip(rows.sources, rows.kinds, strict=True) if kind in STRONG})
            seen = np.concatenate([_whole(held_rows(rows, name)) for name in real if name != source] or [held[:0]])
            if len(held) < SOURCE_ROWS or len(seen) < CLASS_ROWS or len(prior.dims) < 3 or prior.tier == "norm":
                continue
            if (np.abs(np.log(seen[:, 0] / seen[:, 1])) < 1e-3).mean() > ROUND_SHARE:
                continue
            seen = generator.permutation(seen)[:MOST_ROWS]
            alone = replace(prior, shared_covariance=0 * prior.shared_covariance)
            own = [rows.axes.index(dim) for dim in prior.dims]
            densities = (
                prior.log_density(held[:, own]),
                alone.log_density(held[:, own]),
                _authors(seen).score_samples(held) + np.log(held).sum(axis=1),
                _by_bic(np.log(seen)).score_samples(np.log(held)),
            )
            yield [float(one.mean()) for one in densities]


def _whole(sizes: FloatArray) -> FloatArray:
    return sizes[~np.isnan(sizes).any(axis=1)]


def _authors(sizes: FloatArray) -> Any:
    from sklearn.mixture import BayesianGaussianMixture

    return _regularised(BayesianGaussianMixture, sizes, n_components=max(len(sizes) // 3, 1), random_state=SEED)


def _regularised(kind: Any, sizes: FloatArray, **options: Any) -> Any:
    """The fit with scikit-learn's own regularisation, ten times that as often as its Cholesky factor fails."""
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
