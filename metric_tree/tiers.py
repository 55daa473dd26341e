"""Tiers: the evidence of a size in six classes (docs/reference/tiers.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate
from typing import Any, NamedTuple  # defined in a quarter of the time of a dataclass, in each query

from metric_base.errors import InputError

#: The tiers, the best first.
TIERS = ("norm", "measured", "few", "models", "borrowed", "judged")

#: Minimum effective number of rows (products, measurements, norms) of the tier `measured`: ten rows determine a median
#: to 1/3 of the standard deviation.
MIN_MEASURED_ROWS = 10.0

#: Minimum number of sources of the tier `measured`, so that the size is not of a single shop.
MIN_MEASURED_SOURCES = 2

#: Minimum effective number of rows of the tier `few`; with fewer, other evidence determines the tier.
MIN_FEW_ROWS = 3.0

#: Maximum fraction of the covariance or the mean from the parent, 0 to 1; above, the tier is `borrowed`.
MAX_BORROWED_FRACTION = 0.5

#: Maximum fraction of a judged range in the fit, 0 to 1; above, the tier is `judged`.
MAX_JUDGED_FRACTION = 0.5

#: Kinds of evidence of real objects, of models, and of judged ranges (`curated` before release 3.0.0).
_REAL = ("product", "measured", "standard", "statistic")
_MODELS = ("asset", "museum", "default")
_JUDGED = ("judged", "curated")

_WORDS = {
    "norm": "By a norm",
    "measured": "Measured",
    "few": "From few items",
    "models": "From models and museum pieces",
    "borrowed": "Borrowed from its kin",
    "judged": "A language model's judgement",
}


class Evidence(NamedTuple):
    """Counts of the evidence of a size."""

    rows: float = 0.0  #: Effective number of rows of products, measurements, tables of norms and published means.
    sources: int = 0  #: Number of sources of these rows.
    models: int = 0  #: Number of rows of artists' models, museum pieces and category defaults.
    ranges: int = 0  #: Number of judged ranges.

    def record(self) -> dict[str, Any]:
        """Return the counts as in a release and in the JSON of a command."""
        return self._asdict() | {"rows": round(self.rows, 2)}

    @classmethod
    def total(cls, parts: Iterable[Evidence], sources: int) -> Evidence:
        """Return the total of several classes with `sources` different sources."""
        parts = list(parts)
        rows, models, ranges = (sum(getattr(one, name) for one in parts) for name in ("rows", "models", "ranges"))
        return cls(rows, sources, models, ranges)


def leaf_tier(evidence: Evidence, borrowed: float, judged: float, is_norm: bool = False) -> str:
    """Return the tier of one class.

    Parameters
    ----------
    evidence : Evidence
        Counts of the class.
    borrowed : float
        Fraction of the covariance or the mean that comes from the parent, 0 to 1.
    judged : float
        Fraction of a judged range in the fit, 0 to 1.
    is_norm : bool
        Whether a norm fixes the size.

    >>> leaf_tier(Evidence(rows=12.0, sources=3), 0.0, 0.6), leaf_tier(Evidence(rows=12.0, sources=1), 0.4, 0.0)
    ('measured', 'few')
    >>> leaf_tier(Evidence(rows=1.0, sources=1), 0.9, 0.0), leaf_tier(Evidence(models=4, ranges=1), 0.0, 0.8)
    ('borrowed', 'judged')
    """
    if is_norm:
        return "norm"
    if evidence.rows >= MIN_MEASURED_ROWS and evidence.sources >= MIN_MEASURED_SOURCES:
        return "measured"
    if borrowed > MAX_BORROWED_FRACTION:
        return "borrowed"
    if evidence.rows >= MIN_FEW_ROWS:
        return "few"
    if judged > MAX_JUDGED_FRACTION or (evidence.ranges and not evidence.models):
        return "judged"
    return "models" if evidence.models else "few" if evidence.rows > 0 else "borrowed"


def mixture_tier(parts: Iterable[tuple[str, float]]) -> str:
    """Return the tier of a mixture of (tier, weight): at least half of the weight has this tier or a better one.

    >>> mixture_tier([("measured", 0.3), ("few", 0.3), ("judged", 0.4)])
    'few'
    """
    weights = dict.fromkeys(TIERS, 0.0)
    for tier, weight in parts:
        weights[tier] += weight
    half = sum(weights.values()) / 2
    reached = zip(weights, accumulate(weights.values()), strict=True)
    return next(tier for tier, weight in reached if weight >= half)


def tier_of_shares(shares: Mapping[str, float], n: int, n_sources: int, borrowed: float) -> str:
    """Return the tier of a row of a release before 3.0.0, which does not distinguish norms.

    shares : fractions of the weight of the fit by kind; n : number of items; n_sources : number of sources of any kind.
    """
    total = sum(shares.values()) or 1.0
    real, models, judged = (sum(shares.get(kind, 0.0) for kind in kinds) / total for kinds in (_REAL, _MODELS, _JUDGED))
    sources = max(n_sources - (judged > 0) - (models > 0), int(real > 0))
    evidence = Evidence(real / max(real + models, 1e-12) * n, sources, round(models * n), int(judged > 0))
    return leaf_tier(evidence, borrowed, judged)


def is_at_least(tier: str, least: str) -> bool:
    """Return True if a tier is `least` or a better one.

    Raises
    ------
    InputError
        `least` is not a tier.

    >>> is_at_least("measured", "few"), is_at_least("judged", "few")
    (True, False)
    """
    if least not in TIERS:
        raise InputError(f"at least: expected one of {', '.join(TIERS)}; found {least!r}")
    return TIERS.index(tier) <= TIERS.index(least)


def tier_words(tier: str, norm: str | None = None) -> str:
    """Return the words for a tier, to precede a size.

    >>> tier_words("judged"), tier_words("norm", "ISO 216, table 1")
    ("A language model's judgement", 'By ISO 216, table 1')
    >>> tier_words("norm", "BS EN 771-1: 215 by 102.5 by 65; DIN 105-100: 240 by 115 by 52")
    'By 2 norms'
    """
    if tier != "norm" or not norm:
        return _WORDS[tier]
    count = len(norm.split("; "))
    return f"By {norm}" if count == 1 else f"By {count} norms"
