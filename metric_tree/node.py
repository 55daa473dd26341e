"""A category of a tree, what a name means in it, and the errors of names.

The sizes of an item in its states: an umbrella open and folded, a book that stands, a person who sits.

The prior of a node is of its usual state, or of several where its rows do not say which; `plain` says so. A release has
the states of its nodes in the manifest (`states`): by node the name of each, its sizes in mm and the standard deviation
of ln size. They are judged, and as wide as judged ranges turned out to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_tree.prior import Prior
from metric_tree.release.release import Release
from metric_tree.tiers import Evidence
from metric_tree.tiers import at_least as is_at_least

if TYPE_CHECKING:
    from metric_tree.context import ContextModel, KnownContexts, Where

#: Part of a state's variance that objects of one scene share, as of a judged range.
SHARED = 0.35


def state_priors(node_id: str, record: Sequence[Mapping[str, Any]]) -> dict[str, Prior]:
    """The prior of each state of a node, by its name, from the manifest's record.

    Raises
    ------
    InputError
        A state has no name, no axis, or sizes and spreads that are no positive numbers.
    """
    return {str(state.get("state")): _prior(node_id, state) for state in record}


def _prior(node_id: str, state: Mapping[str, Any]) -> Prior:
    try:
        dims = tuple(state["size_mm"])
        size = np.array([state["size_mm"][dim] for dim in dims], dtype=float)
        sd = np.array([state["sd_log"][dim] for dim in dims], dtype=float)
        known = bool(dims and state["state"] and (size > 0).all() and (sd > 0).all() and np.isfinite([size, sd]).all())
    except (KeyError, TypeError, ValueError):
        known = False
    if not known:
        raise InputError(f"{node_id}: states: expected a name, sizes and spreads of axes; found {dict(state)!r}")
    variance = np.diag(sd**2)
    return Prior(
        node_id=node_id,
        dims=dims,
        weights=np.ones(1),
        means=np.log(size)[None],
        covariances=(1 - SHARED) * variance[None],
        shared_covariance=SHARED * variance,
        n=0,
        n_sources=1,
        share_by_kind={"judged": 1.0},
        borrowed=0.0,
        tier="judged",
        evidence=Evidence(0.0, 0, 0, 1),
    )


class UnknownName(InputError, KeyError):
    """A name that means no node of the tree; the message names the nearest."""

    def __str__(self) -> str:
        return str(self.args[0])


class AmbiguousName(UnknownName):
    """A name that means several nodes alike; the message lists them."""


class ThinEvidence(UnknownName):
    """A node whose size rests on less than was asked for; the message names the nearest above it that does not."""


class NoPrior(UnknownName):
    """Dimensions for which a node has no prior; the message names what exists."""


class Home(Protocol):
    """What a node asks of the tree that it is in (`metric_tree.tree.Tree`)."""

    @property
    def name(self) -> str:
        """The release's name."""
        ...

    @property
    def version(self) -> str:
        """The release's version."""
        ...

    @property
    def release(self) -> Release:
        """The release."""
        ...

    @property
    def context_model(self) -> ContextModel | None:
        """What the release knows of regions and years."""
        ...

    def node(self, node_id: str) -> Node:
        """The node of an id."""
        ...

    def children(self, node_id: str) -> tuple[Node, ...]:
        """The nodes right below a node."""
        ...

    def prior_dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions with a fitted row."""
        ...

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """The prior of a node over `dims`."""
        ...

    def tier(self, node_id: str) -> str | None:
        """The tier of a node's main prior."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A category of the tree. `path` holds names from the root; `level` is 1 at the root and 5 at a leaf."""

    tree: Home
    node_id: str
    name: str
    synset: str | None
    parent_id: str | None
    level: int
    path: tuple[str, ...]
    hypernyms: tuple[str, ...]
    aliases: tuple[str, ...]
    pose: str
    dims: tuple[str, ...]
    n_items: int
    n_own: int

    def __repr__(self) -> str:
        return f"<Node {self.node_id}: {' > '.join(self.path)}>"

    @property
    def parent(self) -> Node | None:
        """The node above, None at the root."""
        return None if self.parent_id is None else self.tree.node(self.parent_id)

    @property
    def children(self) -> tuple[Node, ...]:
        """The nodes right below."""
        return self.tree.children(self.node_id)

    def descendants(self) -> Iterator[Node]:
        """The node itself and all below it, parents first."""
        yield self
        for child in self.children:
            yield from child.descendants()

    def items(self, columns: Sequence[str] | None = None) -> pa.Table:
        """The shipped items at or below this node, one row each.

        Parameters
        ----------
        columns : that are read; all by default.

        Returns
        -------
        pyarrow.Table
            Columns of `metric_tree.release.schema.ITEMS`: `item_id`, `node_id`, `source`, `source_id`, `title`,
            `length_mm`, `width_mm`, `height_mm` (mm in the ordinary pose, null where not known), `extents_mm` (every
            stated outer size in mm, longest first), `kind`, `year`, `region`, `url`, `licence`, `flags`. Items that
            may be used for the fit and not shipped are not among them, so that there may be fewer rows than `n_items`.

        >>> import metric_tree
        >>> items = metric_tree.open().find("mug").items()
        >>> items.column_names[5:8], items.num_rows > 0
        (['length_mm', 'width_mm', 'height_mm'], True)
        """
        return self._rows("items", columns)

    def images(self) -> pa.Table:
        """The images of items at or below this node (`metric_tree.release.schema.IMAGES`)."""
        return self._rows("images")

    @property
    def prior_dims(self) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions that have a fitted row of their own."""
        return self.tree.prior_dims(self.node_id)

    @property
    def contexts(self) -> KnownContexts:
        """The regions, countries and years of which the node's sources say something: what `where` may ask for.

        >>> import metric_tree
        >>> "IN" in metric_tree.open().find("car").contexts.regions
        True
        """
        from metric_tree.context import known_contexts

        rows = self.prior_dims
        return known_contexts(self.tree.prior(self.node_id, max(rows, key=len)).contexts if rows else ())

    def prior(self, dims: Sequence[str] | None = None, where: Where | Mapping[str, Any] | str | None = None) -> Prior:
        """The size prior over `dims` (`node.dims` by default), in that order.

        It is the exact row, else the marginal of the smallest row that contains them. One name may stand alone.
        With `where` (`{"region": "europe", "year": 2011}`, either or both) it is that of objects there and then, as far
        as the release knows; its `note` says what that changed.

        Raises
        ------
        NoPrior
            No row contains them.
        InputError
            `where` names no region, country or year.

        >>> import metric_tree
        >>> car = metric_tree.open().find("car")
        >>> car.prior().note, car.prior(where={"region": "europe", "year": 2011}).note[:12]
        (None, 'europe, 2011')
        """
        if isinstance(dims, str):  # a sequence of letters, which nobody means
            dims = (dims,)
        prior = self.tree.prior(self.node_id, tuple(dims) if dims is not None else self.dims)
        if where is None:
            return prior
        from metric_tree.context import where_of

        return self._with_own_centre(prior).in_context(where_of(where), self.tree.context_model)

    def _with_own_centre(self, prior: Prior) -> Prior:
        """The prior with every context as an offset from its own centre.

        What a source states about objects called by the node's plain name is copied from the leaf of these, as an
        offset from the centre of that leaf.
        """
        moved: dict[tuple[object, ...], FloatArray] = {}
        for child in self.children if prior.contexts else ():
            if any(set(prior.dims) <= set(dims) for dims in child.prior_dims):
                leaf = self.tree.prior(child.node_id, prior.dims)
                apart = leaf.weights @ leaf.means - prior.weights @ prior.means
                moved |= {one.key: apart for one in leaf.contexts}
        contexts = (replace(one, offset=one.offset + moved.get(one.key, 0.0)) for one in prior.contexts)
        return replace(prior, contexts=tuple(contexts))

    @property
    def states(self) -> dict[str, Prior]:
        """The sizes of such an item by its states, where it has some: a language model's judgement.

        >>> import metric_tree
        >>> sorted(metric_tree.open().find("umbrella").states)
        ['folded', 'open']
        """
        return state_priors(self.node_id, self._state_records())

    @property
    def plain_state(self) -> str | None:
        """The state that the prior is of, or `mixed: ` and what it holds; None of what has no states.

        >>> import metric_tree
        >>> tree = metric_tree.open()
        >>> tree.find("umbrella").plain_state, tree.find("television").plain_state
        ('folded', 'mixed: shops do not say whether with the stand')
        """
        return next((str(one["plain"]) for one in self._state_records() if one.get("plain")), None)

    def _state_records(self) -> Sequence[Mapping[str, Any]]:
        known = self.tree.release.manifest.get("states", {})
        return known.get(self.node_id.removesuffix("/other"), ())  # type: ignore[no-any-return]

    @property
    def height_is(self) -> str | None:
        """Between which levels the prior's height is, where that needs words; `mixed: ` and what it holds.

        >>> import metric_tree
        >>> metric_tree.open().find("bathtub").height_is
        'rim to floor, outside'
        """
        return self._height_record().get("height")

    @property
    def underside_seen(self) -> bool:
        """False of what is built in (a sink, a counter): who looks at it does not see its whole height."""
        return bool(self._height_record().get("underside_seen", True))

    def _height_record(self) -> Mapping[str, Any]:
        known = self.tree.release.manifest.get("heights", {})
        return known.get(self.node_id.removesuffix("/other"), {})  # type: ignore[no-any-return]

    @property
    def tier(self) -> str | None:
        """What its size rests on, one of `metric_tree.tiers.TIERS`; None of a node without a prior."""
        return self.tree.tier(self.node_id)

    def _rows(self, table: str, columns: Sequence[str] | None = None) -> pa.Table:
        return self.tree.release.table(table, {node.node_id for node in self.descendants()}, columns)


@dataclass(frozen=True, slots=True, eq=False)
class Meaning:
    """What a text means in a tree; `note` says what was left out of it ("taken as whale: 'blue' is not in the tree").

    `how` is `id`, `code`, `own name`, `alias`, `label list`, `folded` (another spelling or number of a name), `other
    name` (of a norm, or in German, French, Spanish or Italian), `modifier stripped`, `broader kind` or `misspelt` (one
    letter off a name); `margin` says how much more evidence the node has than for the next that is unrelated (infinite
    where nothing else is meant), and `alternatives` are the others, the likeliest first.
    """

    node: Node
    how: str
    margin: float
    alternatives: tuple[Node, ...]
    ambiguous: bool
    note: str | None = None


def require_tier(node: Node, least: str) -> None:
    """ThinEvidence unless a node's size rests on the tier `least` or a better one."""
    if node.tier is not None and is_at_least(node.tier, least):
        return
    above, own = node.parent, node.tier or "no size"
    while above is not None and (above.tier is None or not is_at_least(above.tier, least)):
        above = above.parent
    instead = f"; {above.name!r} above it is {above.tier}" if above is not None else ""
    raise ThinEvidence(f"{node.node_id}: tier: expected {least} or better; found {own}{instead}")


def node_of(tree: Home, row: dict[str, Any]) -> Node:
    """The node of a row of `metric_tree.release.schema.NODES`."""
    lists = {name: tuple(row[name] or ()) for name in ("path", "hypernyms", "aliases", "dims")}
    return Node(tree=tree, **{**{name: row[name] for name in row if name in Node.__dataclass_fields__}, **lists})
