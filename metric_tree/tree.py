"""The tree of a release, as a program asks it: names, nodes, items, images, priors.

The table of priors of a release: read when the first prior is asked for, each prior made once.

The sizes of a release as one flat table: a row for each node or label, a column for each dimension and quantile.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from metric_base import spelling
from metric_tree.node import AmbiguousName, Meaning, Node, NoPrior, UnknownName, node_of, require_tier
from metric_tree.prior import QUANTILES, Prior
from metric_tree.release.registry import release_directory
from metric_tree.release.release import Release, check_nodes, open_release
from taxonomy.naming.names import Names
from taxonomy.naming.resolver import Resolver
from taxonomy.words.senses import label_votes

if TYPE_CHECKING:
    from metric_tree.context import ContextModel

#: Dimensions of the columns.
DIMS = ("length", "width", "height", "extent1", "extent2", "extent3")
#: Stands for all label lists of detectors where a vocabulary is asked for.
DETECTORS = "detectors"
#: As many rivals as an ambiguous name's message lists.
MAX_LISTED_NAMES = 4
#: Characters of a name; a longer text is no name of an object.
LONGEST_NAME = 300
#: Every id has one of these, and hardly a name: earlier ids are looked up for such texts alone.
_ID_MARKS = frozenset(".:/")


class PriorRows:
    """The priors of a release by node and dimensions."""

    def __init__(self, release: Release) -> None:
        self._release = release
        self._priors: dict[tuple[str, tuple[str, ...]], Prior] = {}

    def dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions for which a node has a fitted row."""
        return tuple(dims for dims, _ in self._rows(node_id))

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """The prior of a node over `dims`, from its row with the fewest dimensions that hold them."""
        key = (node_id, dims)
        if key not in self._priors:
            self._priors[key] = self._read(node_id, dims)
        return self._priors[key]

    def _read(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        rows = self._rows(node_id)
        containing = [(len(had), row) for had, row in rows if set(dims) <= set(had)]
        if not containing or not dims:
            exists = "; ".join(", ".join(had) for had, _ in rows) or "none"
            wanted = ", ".join(dims) or "no dimension"
            raise NoPrior(f"{node_id}: dims: expected a prior that holds {wanted}; found {exists}")
        prior = Prior.of_row(self._table.slice(min(containing)[1], 1).to_pylist()[0])
        return prior if prior.dims == dims else prior.marginal(dims)

    def _rows(self, node_id: str) -> list[tuple[tuple[str, ...], int]]:
        """Dimensions and rows of the priors of a node."""
        dims, places = self._table["dims"], self._places.get(node_id, ())
        return [(tuple(dims[place].as_py()), place) for place in places]

    @cached_property
    def _table(self) -> pa.Table:
        return self._release.table("priors")

    @cached_property
    def _places(self) -> dict[str, list[int]]:
        """Rows of the table by node."""
        places: defaultdict[str, list[int]] = defaultdict(list)
        for place, node_id in enumerate(self._table["node_id"].to_pylist()):
            places[node_id].append(place)
        return places


def quantile_columns() -> list[str]:
    """Names of the columns of sizes: `height_q50_mm`."""
    return [f"{dim}_q{round(100 * q):02d}_mm" for dim in DIMS for q in QUANTILES]


def quantile_table(entries: Iterable[tuple[dict[str, Any], Prior | None]], labelled: bool = False) -> pa.Table:
    """A table of facts and sizes in mm; null where a dimension is not known.

    Parameters
    ----------
    entries : of each row `node_id`, `name`, `level`, `tier`, `n_items`, as far as they are known, and its prior
    labelled : whether each row begins with a `label`
    """
    kinds = {"node_id": pa.string(), "name": pa.string(), "level": pa.int8(), "tier": pa.string()}
    kinds |= {"n_items": pa.int64(), "n_sources": pa.int64()}
    facts = [pa.field(name, kind) for name, kind in kinds.items()]
    sizes = [pa.field(name, pa.float64(), metadata={"unit": "mm"}) for name in quantile_columns()]
    label = [pa.field("label", pa.string())] if labelled else []
    rows = [{**known, **_sizes(prior)} for known, prior in entries]
    return pa.Table.from_pylist(rows, schema=pa.schema([*label, *facts, *sizes]))


def _sizes(prior: Prior | None) -> dict[str, Any]:
    if prior is None:
        return {}
    row: dict[str, Any] = {"n_sources": prior.n_sources}
    for q, sizes in zip(QUANTILES, prior.quantiles(QUANTILES), strict=True):
        for dim, mm in zip(prior.dims, sizes, strict=True):
            row[f"{dim}_q{round(100 * q):02d}_mm"] = float(f"{mm:.5g}")
    return row


class Tree:
    """A release in memory: a node, priors and items are read when they are asked for."""

    def __init__(self, release: Release) -> None:
        self.release: Release = release
        self._table = release.table("nodes")
        ids = self._table["node_id"].to_pylist()
        self._parents = self._table["parent_id"].to_pylist()  # by place
        check_nodes(ids, self._parents, release.directory)
        self._places = {node_id: place for place, node_id in enumerate(ids)}
        self._nodes: dict[str, Node] = {}
        self._prior_rows = PriorRows(release)

    def __repr__(self) -> str:
        return f"<Tree {self.name} {self.version}: {len(self)} nodes>"

    def __iter__(self) -> Iterator[Node]:
        if len(self._nodes) < len(self):  # all at once, where one by one takes ten times as long
            for row in self._table.to_pylist():
                self._nodes.setdefault(row["node_id"], node_of(self, row))
        return (self._nodes[node_id] for node_id in self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        """Return True if `find` answers a name; a node is asked for by its id."""
        if isinstance(name, Node):
            return name.node_id in self._places
        if not isinstance(name, str):
            return False
        answer = self._resolver.answer(name)
        return answer is not None and not answer.ambiguous

    @property
    def name(self) -> str:
        """The release's name."""
        return str(self.release.manifest["name"])

    @property
    def version(self) -> str:
        """The release's semantic version."""
        return str(self.release.manifest["version"])

    @property
    def context_model(self) -> ContextModel | None:
        """What the release knows of regions and years; None of an older one."""
        from metric_tree.context import ContextModel

        record = self.release.manifest.get("context_model")
        return ContextModel(**record) if record else None

    @property
    def root(self) -> Node:
        """The one node of level 1."""
        return self.node(self._below[None][0])

    def leaves(self) -> tuple[Node, ...]:
        """The nodes without children."""
        return tuple(node for node in self if node.node_id not in self._below)

    def has_node(self, node_id: str) -> bool:
        """Return True if a node has this id."""
        return node_id in self._places

    def node(self, node_id: str) -> Node:
        """The node of an id; UnknownName if no node has it."""
        node_id = self._successors.get(node_id, node_id) if node_id not in self._places else node_id
        if node_id not in self._places:
            raise UnknownName(f"{node_id}: no node has this id")
        if node_id not in self._nodes:
            (row,) = self._table.slice(self._places[node_id], 1).to_pylist()
            self._nodes.setdefault(node_id, node_of(self, row))
        return self._nodes[node_id]

    def children(self, node_id: str) -> tuple[Node, ...]:
        """The nodes right below a node."""
        return tuple(self.node(child) for child in self._below.get(node_id, ()))

    def find(
        self, name: str, vocabulary: str | None = None, *, advice: bool = True, at_least: str | None = None
    ) -> Node:
        """The node that a name means: an id, synset, name, alias, detector label or phrase; see `resolve`.

        Without `advice` the error of an unknown name offers no others, which takes longer than all the rest. With
        `at_least` a node whose size rests on less than that tier (`metric_tree.tiers.TIERS`) is an error.

        Raises
        ------
        UnknownName
            It means no node of the tree.
        AmbiguousName
            It means several, and no evidence prefers one of them: a bat is an animal and a stick.
        ThinEvidence
            Its tier is under `at_least`.

        >>> import metric_tree
        >>> tree = metric_tree.open()
        >>> tree.find("black wooden chairs").node_id
        'chair.n.01'
        """
        meaning = self.resolve(name, vocabulary, advice=advice)
        if meaning.ambiguous:
            rivals = (meaning.node, *meaning.alternatives)[:MAX_LISTED_NAMES]
            candidates = ", ".join(f"{node.node_id} ({node.n_items} items)" for node in rivals)
            raise AmbiguousName(f"{name!r} means several nodes: {candidates}; ask for one of them by its id")
        if at_least is not None:
            require_tier(meaning.node, at_least)
        return meaning.node

    def resolve(self, text: str, vocabulary: str | None = None, *, advice: bool = True) -> Meaning:
        """What a text means, how that was reached, how clear it is, and what else it may mean.

        Case, plurals, spaces, hyphens, underscores, articles, numbers, and British spelling are folded; adjectives,
        colours, materials and rooms are taken away. With `vocabulary` the text is read as that label list reads it;
        `detectors` stands for all of them, the most used first.

        Raises
        ------
        UnknownName
            It means no node of the tree; a spelling that is more than one letter off is not taken for a name.
        taxonomy.label_lists.UnknownLabel
            `vocabulary` is not a list, or the list has no such label.

        >>> import metric_tree
        >>> meaning = metric_tree.open().resolve("black mugs")
        >>> meaning.node.node_id, meaning.how
        ('mug.n.04', 'modifier stripped')
        """
        if not isinstance(text, str) or not text.strip():
            raise UnknownName(f"name: expected a name; found {text!r}")
        if len(text) > LONGEST_NAME:
            raise UnknownName(f"no node is called {text[:40]!r}, with {len(text):,} characters in all")
        if vocabulary is not None and (listed := self._label_node(text, vocabulary)) is not None:
            return Meaning(listed, "label list", math.inf, (), False)
        if text not in self._places and _ID_MARKS.intersection(text) and text in self._successors:
            return Meaning(self.node(text), "id", math.inf, (), False)
        answer = self._resolver.answer(text)
        if answer is None:
            nearest = self._resolver.nearest(text) if advice else ()
            raise UnknownName(f"no node is called {text!r}{spelling.advice(nearest)}")
        nodes = [self.node(candidate.node_id) for candidate in answer.candidates]
        return Meaning(nodes[0], answer.how, answer.margin, tuple(nodes[1:]), answer.ambiguous, answer.note)

    def search(self, text: str, limit: int = 10) -> tuple[Node, ...]:
        """At most `limit` nodes for what a person types, the likeliest first: meanings, beginnings, like spellings.

        A text that is longer than any name finds none.

        >>> import metric_tree
        >>> metric_tree.open().search("wardrob", limit=1)[0].name
        'wardrobe'
        """
        if len(text) > LONGEST_NAME:
            return ()
        return tuple(self.node(node_id) for node_id in self._resolver.nodes_by_relevance(text, limit))

    def names(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Every folded name that a node has, with the ids of the nodes it may mean, the likeliest first."""
        return self._resolver.names()

    def _label_node(self, text: str, vocabulary: str) -> Node | None:
        """The node of a label; None if no list of the detectors has it in this tree."""
        if vocabulary == DETECTORS:
            from taxonomy.words.senses import listed_nodes

            known = (node_id for node_id in listed_nodes(text) if node_id in self._places)
            return next(map(self.node, known), None)
        from taxonomy.label_lists import labelled_node

        node_id = labelled_node(text, vocabulary, self._likely_ids)
        return self.node(self._nearest_place(node_id))

    def _likely_ids(self, text: str) -> tuple[str, ...]:
        answer = self._resolver.answer(text)
        return tuple(one.node_id for one in answer.candidates) if answer else ()

    def _nearest_place(self, node_id: str) -> str:
        """The node, or the nearest kind of it that this release has."""
        if node_id in self._places:
            return node_id
        from taxonomy.words.senses import senses

        lemma = node_id.removeprefix("mt:").partition(".n.")[0].replace("_", " ")
        chains = (sense.chain for sense in senses(lemma) if sense.chain[:1] == (node_id,))
        return next((above for chain in chains for above in chain if above in self._places), node_id)

    def priors(self, vocabulary: str | None = None) -> pa.Table:
        """The quantiles in mm of every node, or of every label of a list, as a flat table.

        Columns: with a vocabulary `label`; `node_id`, `name`, `level`, `tier`, `n_items`, `n_sources`, then
        `length_q05_mm` and the others of `metric_tree.tree.quantile_columns`, of the node's default prior.

        >>> import metric_tree
        >>> table = metric_tree.open().priors(vocabulary="kitti_8")
        >>> table.column_names[:3], table.num_rows
        (['label', 'node_id', 'name'], 8)
        """
        if vocabulary is None:
            return quantile_table(map(self._size_entry, self))
        from taxonomy.label_lists import vocabulary as labels

        known = ((one.label, one.node_id if one.node_id in self._places else None) for one in labels(vocabulary))
        entries = ((label, self._size_entry(self.node(node_id)) if node_id else ({}, None)) for label, node_id in known)
        return quantile_table((({"label": label, **facts}, prior) for label, (facts, prior) in entries), labelled=True)

    def _size_entry(self, node: Node) -> tuple[dict[str, Any], Prior | None]:
        """The facts of a node for a table, and its default prior, None where it has none."""
        try:
            prior = node.prior()
        except NoPrior:
            prior = None
        names = ("node_id", "name", "level", "tier", "n_items")
        return {name: getattr(node, name) for name in names}, prior

    def to_pandas(self, vocabulary: str | None = None) -> Any:
        """The same as a pandas DataFrame; it needs the extra `pandas`."""
        return self.priors(vocabulary).to_pandas()

    def prior_dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """The sets of dimensions for which a node has a fitted row."""
        return self._prior_rows.dims(node_id)

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """The prior of a node over `dims`; see `Node.prior`."""
        return self._prior_rows.prior(node_id, dims)

    def tier(self, node_id: str) -> str | None:
        """The tier of a node's main prior; None of a node without one."""
        if (tier := self._tiers.get(node_id)) is not None:
            return tier
        dims = self.prior_dims(node_id)  # a release before 3.0.0
        return self.prior(node_id, dims[0]).tier if dims else None

    @cached_property
    def _successors(self) -> dict[str, str]:
        """What ids of earlier releases lead to; empty where the release does not say."""
        path = self.release.directory / "successors.parquet"
        if not path.is_file():
            return {}
        table = pq.ParquetFile(path).read()
        return dict(zip(table["old_id"].to_pylist(), table["node_id"].to_pylist(), strict=True))

    @cached_property
    def _tiers(self) -> dict[str, str | None]:
        """Tier by node where the table of nodes has it."""
        if "tier" not in self._table.column_names:
            return {}
        return dict(zip(self._places, self._table["tier"].to_pylist(), strict=True))

    @cached_property
    def _below(self) -> dict[str | None, list[str]]:
        """Ids of the nodes right below each; those of no parent under None."""
        below: dict[str | None, list[str]] = {}
        for node_id, place in self._places.items():
            below.setdefault(self._parents[place], []).append(node_id)
        return below

    @cached_property
    def _resolver(self) -> Resolver:
        names, aliases, items = (self._table[column].to_pylist() for column in ("name", "aliases", "n_items"))
        return Resolver(Names([*self._places], names, aliases, items, self._parents, self._hypernyms_of, label_votes))

    def _hypernyms_of(self, node_id: str) -> tuple[str, ...]:
        return self.node(node_id).hypernyms


def open_tree(ref: str | Path | None = None) -> Tree:
    """The tree of a release: the shipped one, or that of an available version, or of a folder.

    Raises
    ------
    metric_tree.release.release.BadRelease
        There is none, or it is damaged, or of a schema that this version does not read.

    Examples
    --------
    >>> import metric_tree
    >>> metric_tree.open().find("office chair").level
    5
    """
    return Tree(open_release(release_directory(ref)))
