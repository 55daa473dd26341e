"""A category of a tree, the meaning of a name in it, and the errors of names.

A node may have states with other sizes: an umbrella open and folded, a book that is upright, a person who sits. The
prior of the node is of its usual state, or of several if its rows do not state one (`plain`). The manifest of a release
has the states of its nodes (`states`): the name of each, its sizes in mm and the standard deviation of ln size. They
are judged, with the standard deviation that judged ranges have.

Sources state the height of a dog at the withers. For such nodes and those below them, the manifest has the ratio of the
vertical extent with the head to this height (`heights`), and `Node.outer` gives the prior of the outer extents.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray
from metric_base.errors import InputError, UnknownKey
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import STATED_SHARED, Prior
from metric_tree.release.release import Release
from metric_tree.tiers import Evidence, is_at_least

if TYPE_CHECKING:
    from metric_tree.context import ContextModel, KnownContexts, Where
    from metric_tree.variants import StatedSize, Variant

#: State of an animal whose height is at the withers, by its vertical extent.
WITH_HEAD = "standing, with its head"
#: Reason for an axis without a size by tier, if it is not that no source states it.
_UNKNOWN = {
    "norm": "the standard leaves it open",
    "judged": "the judged range leaves it open",
    "models": "no model has it",
}
#: Half-width of the stated range of a ratio in standard deviations: 90 % of the objects are between its ends.
HALF_WIDTH_SD = 1.645


def state_priors(node_id: str, record: Sequence[Mapping[str, Any]]) -> dict[str, Prior]:
    """Return the prior of each state of a node by its name, from the record of the manifest.

    Raises
    ------
    InputError
        A state has no name, no axis, or sizes and standard deviations that are not positive numbers.
    """
    priors = {}
    for state in record:
        try:
            dims = tuple(state["size_mm"])
            size = np.array([state["size_mm"][dim] for dim in dims], dtype=float)
            sd = np.array([state["sd_log"][dim] for dim in dims], dtype=float)
            is_valid = bool(dims and state["state"] and np.isfinite([size, sd]).all() and min(*size, *sd) > 0)
        except (KeyError, TypeError, ValueError):
            is_valid = False
        if not is_valid:
            raise InputError(f"{node_id}: states: expected a name, sizes and spreads of axes; found {dict(state)!r}")
        variance = np.diag(sd**2)
        priors[str(state["state"])] = Prior(
            node_id=node_id,
            dims=dims,
            weights=np.ones(1),
            means=np.log(size)[None],
            covariances=(1 - STATED_SHARED) * variance[None],
            shared_covariance=STATED_SHARED * variance,
            n=0,
            n_sources=1,
            share_by_kind={"judged": 1.0},
            borrowed=0.0,
            tier="judged",
            evidence=Evidence(0.0, 0, 0, 1),
        )
    return priors


class UnknownName(UnknownKey):
    """A name or id without a node in the tree; `Tree.find` and `Tree.resolve` list similar names unless disabled."""


class AmbiguousName(UnknownName):
    """A name with several nodes of similar evidence; the message lists them."""


class ThinEvidence(UnknownName):
    """A node whose tier is below the required one; the message names the closest ancestor with this tier."""


class NoPrior(UnknownName):
    """Dimensions for which a node has no prior; the message lists the existing ones."""


class _Tree(Protocol):
    """The part of `metric_tree.tree.Tree` that a node uses; that module imports this one."""

    @property
    def name(self) -> str: ...
    @property
    def version(self) -> str: ...
    @property
    def release(self) -> Release: ...
    @property
    def context_model(self) -> ContextModel | None: ...
    def node(self, node_id: str) -> Node: ...
    def children(self, node_id: str) -> tuple[Node, ...]: ...
    def prior_dims(self, node_id: str) -> tuple[tuple[str, ...], ...]: ...
    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior: ...
    def tier(self, node_id: str) -> str | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A category of the tree."""

    tree: _Tree
    node_id: str
    name: str
    synset: str | None
    parent_id: str | None
    level: int  #: 1 for the root to 5 for a leaf.
    path: tuple[str, ...]  #: Names from the root to the node.
    hypernyms: tuple[str, ...]
    aliases: tuple[str, ...]
    pose: str
    dims: tuple[str, ...]
    n_items: int  #: Items at or below the node.
    n_own: int  #: Items of the node itself.
    #: Sources of its fit and of those of the nodes below it; none in a release before 4.0.0.
    sources: tuple[str, ...] = ()
    stated: StatedSize | None = None  #: Variant, or size in the name, by which `Tree.find` returned the node.
    #: Part of the name that `Tree.find` ignored, if it is more specific: "taken as whale: 'blue' is not in the tree".
    note: str | None = None

    def __repr__(self) -> str:
        return f"<Node {self.node_id}: {' > '.join(self.path)}>"

    @property
    def parent(self) -> Node | None:
        """Parent node; None for the root."""
        return None if self.parent_id is None else self.tree.node(self.parent_id)

    @property
    def children(self) -> tuple[Node, ...]:
        """Child nodes."""
        return self.tree.children(self.node_id)

    def ancestors(self) -> Iterator[Node]:
        """Yield the nodes above the node, from its parent to the root."""
        above = self.parent
        while above is not None:
            yield above
            above = above.parent

    def descendants(self) -> Iterator[Node]:
        """Yield the node and all nodes below it, parents first."""
        yield self
        for child in self.children:
            yield from child.descendants()

    def items(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the shipped items at or below this node, one row each.

        Parameters
        ----------
        columns : sequence of str, optional
            Columns to read; default all.

        Returns
        -------
        pyarrow.Table
            Columns of `metric_tree.release.schema.ITEMS`: `item_id`, `node_id`, `source`, `source_id`, `title`,
            `length_mm`, `width_mm`, `height_mm` (mm in the ordinary pose, null if unknown), `extents_mm` (all stated
            outer sizes in mm, longest first), `kind`, `year`, `region`, `url`, `licence`, `flags`, `attribution`,
            `mass_kg`, `volume_l` (null where the source states none). Items that are used for the fit but not shipped
            are not included, so that there may be fewer rows than `n_items`.

        >>> import metric_tree
        >>> items = metric_tree.open().find("mug").items()
        >>> items.column_names[5:8], items.num_rows > 0
        (['length_mm', 'width_mm', 'height_mm'], True)
        """
        return self._rows("items", columns)

    def images(self) -> pa.Table:
        """Return the images of items at or below this node (`metric_tree.release.schema.IMAGES`)."""
        return self._rows("images")

    @property
    def prior_dims(self) -> tuple[tuple[str, ...], ...]:
        """Sets of dimensions for which the node has a row in the table of priors."""
        return self.tree.prior_dims(self.node_id)

    @property
    def contexts(self) -> KnownContexts:
        """Regions, countries and years with data of the node, for the argument `where` of `prior`.

        >>> import metric_tree
        >>> "IN" in metric_tree.open().find("car").contexts.regions
        True
        """
        from metric_tree.context import known_contexts
        from metric_tree.populations import populations

        dims = max(self.prior_dims, key=len, default=None)
        contexts = self.tree.prior(self.node_id, dims).contexts if dims else ()
        places = [(one.region, one.year) for one in contexts]
        rows = populations().get(self.node_id, ())
        return known_contexts((*places, *((row.region, row.year) for row in rows)))

    def prior(self, dims: Sequence[str] | None = None, where: Where | Mapping[str, Any] | str | None = None) -> Prior:
        """Return the size prior over some dimensions, in their order.

        Parameters
        ----------
        dims : sequence of str or str, optional
            Dimensions; default `node.dims`. If no row has exactly these, the prior is a marginal of the smallest row
            that contains them.
        where : Where, mapping or str, optional
            Region and year of the objects, either or both, such as `{"region": "europe", "year": 2011}`. The `note` of
            the prior states the effect.

        Raises
        ------
        NoPrior
            No row contains the dimensions.
        InputError
            `where` has no known region, country or year.

        If the name of the node stated a size (`stated`), the prior has this size, and `where` has no effect. For a
        category with variants of the region, of the tier `norm` or with shares, the prior is their mixture.

        >>> import metric_tree
        >>> car = metric_tree.open().find("car")
        >>> car.prior().note, car.prior(where={"region": "europe", "year": 2011}).note[:12]
        (None, 'europe, 2011')
        """
        if isinstance(dims, str):  # also a sequence of str
            dims = (dims,)
        prior = self.tree.prior(self.node_id, tuple(dims) if dims is not None else self.dims)
        if self.stated is not None:
            return self.stated.of(prior, self.dims[0] == EXTENTS[0])
        if where is None:
            return prior
        from metric_tree.context import where_of
        from metric_tree.populations import population_contexts
        from metric_tree.variants import regional_prior

        where = where_of(where)
        regional = regional_prior(prior, self.variants, where, self.dims[0] == EXTENTS[0])
        if regional is not None:
            return regional

        # The node has a copy of the contexts of its leaf `<id>/other`, whose offsets are from the centre of this leaf.
        corrections: dict[tuple[object, ...], FloatArray] = {}
        for child in self.children if prior.contexts else ():
            if any(set(prior.dims) <= set(child_dims) for child_dims in child.prior_dims):
                leaf = self.tree.prior(child.node_id, prior.dims)
                difference = leaf.weights @ leaf.means - prior.weights @ prior.means
                corrections |= {one.key: difference for one in leaf.contexts}
        contexts = [replace(one, offset=one.offset + corrections.get(one.key, 0.0)) for one in prior.contexts]
        where, local = population_contexts(self.node_id, prior, where)
        known = replace(prior, contexts=(*contexts, *local))
        return known.in_context(where, self.tree.context_model)

    @property
    def variants(self) -> tuple[Variant, ...]:
        """Named variants of the node: real sizes with region and document; empty without any.

        >>> import metric_tree
        >>> [one.name for one in metric_tree.open().find("vinyl record").variants]
        ['30 cm', '25 cm', '17 cm']
        """
        from metric_tree.variants import variants

        return variants().get(self.node_id, ())

    @property
    def states(self) -> dict[str, Prior]:
        """Priors of the states of the object by name, judged by a language model; empty without states.

        >>> import metric_tree
        >>> sorted(metric_tree.open().find("umbrella").states)
        ['folded', 'open']
        """
        states = state_priors(self.node_id, self._manifest_entry("states", ()))
        if self._height.get("extent") and self.prior_dims:
            prior = self.outer(self.tree.prior(self.node_id, max(self.prior_dims, key=len)))
            states[WITH_HEAD] = replace(prior, tier="judged", norm=None)
        return states

    def outer(self, prior: Prior) -> Prior:
        """Return a prior of the node with the vertical extent as its height.

        For an animal whose height is at the withers, the vertical extent is that of the standing animal with its head:
        the height times a ratio, whose spread is added. Other priors are unchanged.

        >>> import metric_tree
        >>> beagle = metric_tree.open().find("beagle")
        >>> (beagle.outer(beagle.prior()).quantile(0.5) / beagle.prior().quantile(0.5)).round(3).tolist()
        [1.2]
        """
        ratio = self._height.get("extent")
        if not ratio or "height" not in prior.dims:
            return prior
        low, typical, high = np.log(np.asarray(ratio, dtype=float))
        is_height = np.array([dim == "height" for dim in prior.dims], dtype=float)
        variance = ((high - low) / (2 * HALF_WIDTH_SD)) ** 2
        return replace(
            prior,
            means=prior.means + typical * is_height,
            covariances=prior.covariances + np.diag(variance * is_height),
        )

    @property
    def plain_state(self) -> str | None:
        """State of the objects of the prior, or `mixed: ` and the states; None without states.

        >>> import metric_tree
        >>> tree = metric_tree.open()
        >>> tree.find("umbrella").plain_state, tree.find("television").plain_state
        ('folded', 'mixed: shops do not say whether with the stand')
        """
        return next((str(one["plain"]) for one in self._manifest_entry("states", ()) if one.get("plain")), None)

    @property
    def height_is(self) -> str | None:
        """Definition of the height of the prior, or `mixed: ` and the definitions; None for the usual height.

        >>> import metric_tree
        >>> metric_tree.open().find("bathtub").height_is
        'rim to floor, outside'
        """
        height: str | None = self._height.get("height")
        return height

    @property
    def unknown_axes(self) -> str | None:
        """Axes on which the node has no size, and the reason; None if the size is complete.

        >>> import metric_tree
        >>> metric_tree.open().find("sloop").unknown_axes
        'height: no source states it'
        """
        dims = {dim for names in self.prior_dims for dim in names}
        missing = " and ".join(axis for axis in (EXTENTS if dims & set(EXTENTS) else AXES) if axis not in dims)
        return f"{missing}: {_UNKNOWN.get(self.tier or '', 'no source states it')}" if missing and dims else None

    @property
    def underside_seen(self) -> bool:
        """False for built-in objects (a sink, a counter), whose complete height is not visible."""
        return bool(self._height.get("underside_seen", True))

    @property
    def _height(self) -> Mapping[str, Any]:
        """Definition of the height in the manifest: of the node, or the nearest one above with a ratio of extents."""
        entries = self.tree.release.manifest.get("heights", {})
        above = (entries[one.node_id] for one in self.ancestors() if "extent" in entries.get(one.node_id, {}))
        entry: Mapping[str, Any] = self._manifest_entry("heights", None) or next(above, {})
        return entry

    def _manifest_entry(self, field: str, default: object) -> Any:
        """Return the entry of the node, or of the node whose leaf it is, in a field of the manifest."""
        return self.tree.release.manifest.get(field, {}).get(self.node_id.removesuffix("/other"), default)

    @property
    def tier(self) -> str | None:
        """Tier of the evidence of the size (`metric_tree.tiers.TIERS`); None for a node without a prior."""
        return self.tree.tier(self.node_id)

    def _rows(self, table: str, columns: Sequence[str] | None = None) -> pa.Table:
        return self.tree.release.table(table, {node.node_id for node in self.descendants()}, columns)


@dataclass(frozen=True, slots=True, eq=False)
class Meaning:
    """The node of a text in a tree."""

    node: Node
    #: Rule that matched: `id`, `code`, `own name`, `alias`, `label list`, `folded` (another spelling or number of a
    #: name), `other name` (of a norm, or in German, French, Spanish or Italian), `modifier stripped`, `broader kind`,
    #: `misspelt` (one wrong letter), or `variant` (`metric_tree.variants`).
    how: str
    #: Difference of the evidence from the next unrelated node; infinite without one.
    margin: float
    #: Other nodes of the text, the most likely first.
    alternatives: tuple[Node, ...]
    ambiguous: bool
    #: Part of the text that was ignored: "taken as chair: 'black' is not in the tree".
    note: str | None = None


def require_tier(node: Node, least: str) -> None:
    """Raise ThinEvidence if the tier of a node is below `least`."""
    if node.tier is not None and is_at_least(node.tier, least):
        return
    above = next((one for one in node.ancestors() if one.tier is not None and is_at_least(one.tier, least)), None)
    instead = f"; {above.name!r} above it is {above.tier}" if above is not None else ""
    raise ThinEvidence(f"{node.node_id}: tier: expected {least} or better; found {node.tier or 'no size'}{instead}")


def node_of(tree: _Tree, row: dict[str, Any]) -> Node:
    """Return the node of a row of `metric_tree.release.schema.NODES`."""
    lists = {name: tuple(row.get(name) or ()) for name in ("path", "hypernyms", "aliases", "dims", "sources")}
    return Node(tree=tree, **{**{name: row[name] for name in row if name in Node.__dataclass_fields__}, **lists})
