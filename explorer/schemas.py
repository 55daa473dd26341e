"""Records of JSON responses and of query strings, for the static site, the server and its OpenAPI description."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from metric_tree.prior import QUANTILES
from metric_tree.tree import MAX_NAME_CHARS

#: Maximum number of hits of a search, which takes some milliseconds.
MAX_HITS = 50

#: Sizes in mm by dimension and quantile: `{"height": {"0.5": 912.0}}`.
Quantiles = dict[str, dict[str, float]]


class TreeRef(msgspec.Struct):
    """A release."""

    name: str
    version: str


class NodeRef(msgspec.Struct):
    """A node in a list: its id, name, level, tier, median sizes in mm, and what people call its dimensions.

    `axis_names` of all records has the dimensions whose name in everyday use is another one: the `length` of a sofa is
    its width, its `width` the depth.
    """

    node: str
    name: str
    level: int
    tier: str
    n_items: int
    median_mm: dict[str, float]
    axis_names: dict[str, str]


class PriorAnswer(msgspec.Struct, kw_only=True):
    """A size distribution over ln mm: weights (k,), means (k, d), covariances (k, d, d), and B (d, d) between sources.

    `log_density` has one number for each of the sizes in `density_at`.
    """

    schema: str = "metric-tree/prior/1"
    tree: TreeRef
    node: str
    dims: list[str]
    axis_names: dict[str, str]
    tier: str
    n: int
    n_sources: int
    borrowed: float
    share_by_kind: dict[str, float]
    where: str | None
    quantiles_mm: Quantiles
    family: str
    weights: list[float]
    means: list[list[float]]
    covariances: list[list[list[float]]]
    shared_covariance: list[list[float]]
    log_density: list[float] | None = None


class NodeAnswer(NodeRef, kw_only=True):
    """A category: its position in the tree, its sizes and their evidence.

    `sources` are the ids of all sources at or below it, shipped and withheld (`manifest.json` describes them);
    `n_sources` counts those that weigh in the prior.
    """

    schema: str = "metric-tree/node/1"
    tree: TreeRef
    synset: str | None
    path: list[str]
    path_ids: list[str]
    aliases: list[str]
    labels: dict[str, list[str]]
    pose: str
    sentence: str
    note: str | None
    n_shipped: int
    n_images: int
    dims: list[str]
    prior_dims: list[list[str]]
    quantiles_mm: Quantiles
    n_sources: int
    sources: list[str]
    share_by_kind: dict[str, float]
    borrowed: float
    shipped: dict[str, dict[str, int]]
    children: list[NodeRef]
    links: dict[str, str]


class ItemsAnswer(msgspec.Struct, kw_only=True):
    """A page of the shipped items at or below a node; fields without a value are omitted.

    `next` is the address of the page after it, relative to the address of this page.
    """

    schema: str = "metric-tree/items/1"
    tree: TreeRef
    node: str
    n_shipped: int
    items: list[dict[str, Any]]
    next: str | None


class ImagesAnswer(msgspec.Struct, kw_only=True):
    """The images of items at or below a node, the first 12; paths are relative to the release."""

    schema: str = "metric-tree/images/1"
    tree: TreeRef
    node: str
    n_images: int
    images: list[dict[str, Any]]


class ComparedNode(NodeRef):
    """A node of a comparison, with its quantiles."""

    quantiles_mm: Quantiles


class ComparisonAnswer(msgspec.Struct, kw_only=True):
    """Nodes side by side."""

    schema: str = "metric-tree/comparison/1"
    nodes: list[ComparedNode]


class SearchHit(NodeRef):
    """A node that a text may mean."""

    path: list[str]
    labels: dict[str, list[str]]


class SearchAnswer(msgspec.Struct, kw_only=True):
    """Nodes for a text, the likeliest first; `answer` is a sentence about the size of the node that the text names."""

    schema: str = "metric-tree/search/1"
    tree: TreeRef
    query: str
    answer: str | None
    hits: list[SearchHit]


class FitAnswer(msgspec.Struct, kw_only=True):
    """Whether an object fits through or into another one; `probability` is null if a necessary side is not known.

    It is an upper bound if the larger object is a category of containers, of which the outer sides are known. `nodes`
    has the ids of both categories, null for one that the request describes by its sides.
    """

    schema: str = "metric-tree/fit/1"
    tree: TreeRef
    object: str
    into: str
    nodes: list[str | None]
    how: str
    is_upper_bound: bool
    probability: float | None
    reason: str


class ReleaseRef(msgspec.Struct):
    """A release that is served; `base` is its path."""

    name: str
    version: str
    created: str
    base: str
    counts: dict[str, Any]


class ReleasesAnswer(msgspec.Struct, kw_only=True):
    """The releases, the default one first."""

    schema: str = "metric-tree/releases/1"
    releases: list[ReleaseRef]


class VocabularyRow(msgspec.Struct):
    """A label with its node and the size of the node; null if the label has no node or no size."""

    label: str
    node: str | None
    reason: str
    name: str | None
    tier: str | None
    n_items: int | None
    quantiles_mm: Quantiles | None
    axis_names: dict[str, str] = {}


class VocabularyAnswer(msgspec.Struct, kw_only=True):
    """A label list of a detector or a benchmark."""

    schema: str = "metric-tree/vocabulary/1"
    tree: TreeRef
    vocabulary: str
    labels: list[VocabularyRow]


class NoQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Query string of an address without parameters."""


_Text = Annotated[str, Meta(min_length=1, max_length=MAX_NAME_CHARS)]


class SearchQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Query string of a search."""

    q: Annotated[_Text, Meta(description="text to search", examples=["chair"])]
    limit: Annotated[int, Meta(ge=1, le=MAX_HITS, description="maximum number of hits", examples=[5])] = 10


class FitQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Query string of a fit."""

    object: Annotated[_Text, Meta(description="a name or an id, or sides: 210 x 95 x 85 cm", examples=["sofa"])]
    into: Annotated[_Text, Meta(description="the same of the larger object", examples=["door"])]
    how: Annotated[
        Literal["", "through", "in"],
        Meta(description="through an opening or in a container; by default the category decides", examples=["through"]),
    ] = ""


_QUANTILES = ",".join(f"{q:g}" for q in QUANTILES)
_Where = Annotated[str, Meta(description="region and year, or one of them", examples=["region=europe,year=2011"])]


class PriorQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Query string of a prior; lists are separated by commas.

    A field without a description is a former name, which OpenAPI does not list.
    """

    dims: Annotated[
        str, Meta(description="dimensions: length, width, height or extent1, extent2, extent3", examples=["height"])
    ] = ""
    where: _Where = ""
    quantiles: Annotated[str, Meta(description="numbers between 0 and 1", examples=["0.05,0.5,0.95"])] = _QUANTILES
    density_at: Annotated[
        str, Meta(description="sizes in mm, one number per dimension and then the next size", examples=["900,950"])
    ] = ""
    q: str = ""


_Cursor = Annotated[str, Meta(pattern=r"^(p[1-9]\d{0,5})?$")]


class ItemsQuery(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Query string of the items of a node."""

    cursor: Annotated[_Cursor, Meta(description="the token in `next` of the previous page", examples=["p2"])] = ""
    page: _Cursor = ""


#: Maximum number of objects of a request: 500 take about one second.
MAX_OBJECTS = 500
#: Maximum number of known lengths of a request.
MAX_LENGTHS = 100


class KnownLength(msgspec.Struct, forbid_unknown_fields=True):
    """A length in scene units and in metres; `sigma` is the standard deviation of the natural log of their ratio."""

    units: Annotated[float, Meta(gt=1e-12, lt=1e12)]
    metres: Annotated[float, Meta(gt=1e-12, lt=1e12)]
    sigma: Annotated[float, Meta(gt=1e-6, lt=10)] = 0.01


class ScaleRequest(msgspec.Struct, kw_only=True):
    """Measured objects (`metric-tree/objects/1`) with known lengths and a context, both optional."""

    schema: str = "metric-tree/objects/1"
    objects: Annotated[list[dict[str, Any]], Meta(min_length=1, max_length=MAX_OBJECTS)]
    known_lengths: Annotated[list[KnownLength], Meta(max_length=MAX_LENGTHS)] = []
    where: dict[str, Any] | None = None
    level: Annotated[float, Meta(gt=0, lt=1)] = 0.9


class Problem(msgspec.Struct, kw_only=True):
    """An error (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    instance: str | None = None
