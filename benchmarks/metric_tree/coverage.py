"""How many sizes of a source that the fit has not seen lie in a class's 90 % interval, by how many sources it has.

    python -m benchmarks.metric_tree.coverage RAW... [--work DIR]

Each source with real objects in two classes or more is left out in turn, with the sets that measured the same rooms,
and its rows are scored under the fit of the others (`leave_source_out`). Norms are left out: they are no fit. The
sources, in the order of how many classes they have, are dealt to two halves: `metric_tree.fit.class_prior.NEW_SOURCE`
was chosen for the first and for few absurdly wide axes in the first list of `everyday`; the second half and the second
list report. A class counts once for each source. Density: mean of the classes' log densities over ln mm, none counted
as under -6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.metric_tree.leave_source_out import SEED, Rows, left_out, rows_parser, stated_parts
from metric_base.arrays import FloatArray
from metric_cli.terminal import print_table
from metric_tree.fit.class_prior import NEW_SOURCE, NewSource
from metric_tree.prior import Prior

#: The fitted covariances as they are, and the other offsets that are shown: without a bound on either side, as release
#: 3.0.0 was first published (1.25), and around what is in use.
AS_FITTED = NewSource(0.0)
TRIED = (
    AS_FITTED, NewSource(9.0, 0.5), NewSource(9.0, 1.25), NewSource(0.25, 9.0), NewSource(0.2), NEW_SOURCE,
    NewSource(0.3), NewSource(0.35), NewSource(0.25, 3.0),
)  # fmt: skip

#: A class whose name means another object in the source has a density without a floor.
LEAST_DENSITY = -6.0

#: Numbers of sources of real objects that have a line, and how the last is shown.
SOURCES = ("0", "1", "2", "3", "4 and more")


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A source's sizes (n, d) in mm of one class, the prior of all others as fitted, and how many sources those are."""

    source: str
    prior: Prior
    sizes: FloatArray

    @property
    def sources(self) -> int:
        """Sources of real objects behind the prior."""
        return self.prior.evidence.sources if self.prior.evidence else 0

    def score(self, new_source: NewSource) -> tuple[float, float]:
        """Share of the sizes inside the 90 % interval, and mean log density, with an offset of new sources."""
        prior = new_source.widen(self.prior)
        low, high = prior.interval(0.9).T
        inside = (self.sizes >= low) & (self.sizes <= high)
        return float(inside.mean()), max(float(prior.log_density(self.sizes).mean()), LEAST_DENSITY)


def held_out(build: Rows) -> list[Held]:
    """All pairs of a class and a source that has enough rows of it."""
    pairs: list[Held] = []
    for source in left_out(build):
        for rows, prior in build.without(source, AS_FITTED):
            if prior.tier != "norm":
                parts = stated_parts(rows, prior, source, SEED)
                pairs += [Held(source, prior.marginal(dims), chosen) for dims, chosen in parts]
    return pairs


def halves(pairs: Sequence[Held]) -> tuple[list[Held], list[Held]]:
    """The pairs of every second source, by how many classes a source has, and those of the others."""
    count = {name: sum(one.source == name for one in pairs) for name in {one.source for one in pairs}}
    dealt = sorted(count, key=lambda name: (-count[name], name))
    first = set(dealt[::2])
    return [one for one in pairs if one.source in first], [one for one in pairs if one.source not in first]


def cells(pairs: Sequence[Held], new_source: NewSource) -> tuple[str, str]:
    """Mean share inside, and mean density."""
    inside, density = np.array([one.score(new_source) for one in pairs]).mean(axis=0)
    return f"{inside:.3f}", f"{density:.2f}"


def main() -> None:
    """Print coverage by the offset and half, and by the number of sources, before and after."""
    pairs = held_out(Rows.stated(rows_parser(__doc__).parse_args()))
    parts = halves(pairs)
    names = ("chosen on", "other half")
    columns = [f"{what}, {name}" for name in names for what in ("inside", "density")]
    lines = [(f"{one.sd:g}", f"{one.most:g}", *(cell for part in parts for cell in cells(part, one))) for one in TRIED]
    print_table(["sd", "most", *columns], lines)
    groups = [[one for one in pairs if min(one.sources, len(SOURCES) - 1) == n] for n in range(len(SOURCES))]
    print_table(
        ["sources", "pairs", "inside, as fitted", "density", "inside, published", "density"],
        [
            (name, len(own), *cells(own, AS_FITTED), *cells(own, NEW_SOURCE))
            for name, own in zip(SOURCES, groups, strict=True)
            if own
        ],
    )


if __name__ == "__main__":
    main()
