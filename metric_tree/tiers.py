"""What a size rests on, in six tiers (docs/reference/tiers.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple  # which takes a quarter of a dataclass's time in each query

from metric_base.errors import InputError

#: The tiers, the best first.
TIERS = ("norm", "measured", "few", "models", "borrowed", "judged")

#: A class is measured with so many effective rows of products, measurements and norms, of so many sources: ten rows
#: show a median to a third of the spread, and a second source shows that it is not one shop's.
MEASURED_ROWS, MEASURED_SOURCES = 10.0, 2

#: With fewer effective rows than this a class rests on whatever stands beside them: a range, models or its parent.
FEW_ROWS = 3.0

#: A class whose spread or centre is taken from the parent by more than this rests on it.
BORROWED_SHARE = 0.5

#: A judged range with more than this share of the fit is what the size rests on.
JUDGED_SHARE = 0.5

#: Kinds of rows that count as real objects; those of models; those of a judged range, also as older releases call it.
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
    """The counts behind a size.

    rows : effective rows of products, measurements, tables of norms and published means; sources : of those rows;
    models : rows of artists' models, museum pieces and category values; ranges : judged ranges.
    """

    rows: float = 0.0
    sources: int = 0
    models: int = 0
    ranges: int = 0

    def record(self) -> dict[str, Any]:
        """The counts as a release and the JSON of a command have them."""
        return self._asdict() | {"rows": round(self.rows, 2)}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Evidence:
        """The counts of a row of a release."""
        return cls(float(record["rows"]), int(record["sources"]), int(record["models"]), int(record["ranges"]))

    @classmethod
    def total(cls, parts: Iterable[Evidence], sources: int) -> Evidence:
        """The counts of several classes together, of `sources` different sources."""
        own = list(parts)
        return cls(
            sum(one.rows for one in own), sources, sum(one.models for one in own), sum(one.ranges for one in own)
        )


def leaf_tier(evidence: Evidence, borrowed: float, judged: float, is_norm: bool = False) -> str:
    """The tier of one class.

    Parameters
    ----------
    borrowed : share of the spread or the centre that is the parent's; judged : share of the fit that is a range's

    >>> leaf_tier(Evidence(rows=12.0, sources=3), 0.0, 0.6), leaf_tier(Evidence(rows=12.0, sources=1), 0.4, 0.0)
    ('measured', 'few')
    >>> leaf_tier(Evidence(rows=1.0, sources=1), 0.9, 0.0), leaf_tier(Evidence(models=4, ranges=1), 0.0, 0.8)
    ('borrowed', 'judged')
    """
    if is_norm:
        return "norm"
    if evidence.rows >= MEASURED_ROWS and evidence.sources >= MEASURED_SOURCES:
        return "measured"
    if borrowed > BORROWED_SHARE:
        return "borrowed"
    if evidence.rows >= FEW_ROWS:
        return "few"
    if judged > JUDGED_SHARE or (evidence.ranges and not evidence.models):
        return "judged"
    return "models" if evidence.models else "few" if evidence.rows > 0 else "borrowed"


def mixture_tier(parts: Iterable[tuple[str, float]]) -> str:
    """The tier of a mixture of (tier, weight): half of the weight is of this tier or of a better one.

    >>> mixture_tier([("measured", 0.3), ("few", 0.3), ("judged", 0.4)])
    'few'
    """
    weights = dict.fromkeys(TIERS, 0.0)
    for tier, weight in parts:
        weights[tier] += weight
    half, reached = sum(weights.values()) / 2, 0.0
    for tier, weight in weights.items():
        reached += weight
        if reached >= half and reached > 0:
            return tier
    return TIERS[-1]


def tier_of_shares(shares: Mapping[str, float], n: int, n_sources: int, borrowed: float) -> str:
    """The tier of a row of a release older than 3.0.0, from what the row says; no norm can be told there.

    shares : of the fit's weight by kind; n : items; n_sources : sources of any kind.
    """
    total = sum(shares.values()) or 1.0
    real, models, judged = (sum(shares.get(kind, 0.0) for kind in kinds) / total for kinds in (_REAL, _MODELS, _JUDGED))
    sources = max(n_sources - (judged > 0) - (models > 0), int(real > 0))
    evidence = Evidence(real / max(real + models, 1e-12) * n, sources, round(models * n), int(judged > 0))
    return leaf_tier(evidence, borrowed, judged)


def at_least(tier: str, least: str) -> bool:
    """Return True if a tier is `least` or a better one.

    Raises
    ------
    InputError
        `least` is no tier.

    >>> at_least("measured", "few"), at_least("judged", "few")
    (True, False)
    """
    if least not in TIERS:
        raise InputError(f"at least: expected one of {', '.join(TIERS)}; found {least!r}")
    return TIERS.index(tier) <= TIERS.index(least)


def tier_words(tier: str, norm: str | None = None) -> str:
    """What stands before a number of this tier.

    >>> tier_words("judged"), tier_words("norm", "ISO 216, table 1")
    ("A language model's judgement", 'By ISO 216, table 1')
    >>> tier_words("norm", "BS EN 771-1: 215 by 102.5 by 65; DIN 105-100: 240 by 115 by 52")
    'By 2 norms'
    """
    if tier != "norm" or not norm:
        return _WORDS[tier]
    count = len(norm.split("; "))
    return f"By {norm}" if count == 1 else f"By {count} norms"
