"""The tree of a release: names, nodes, items, images and priors; the sizes of a release as a flat table."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from metric_base import spelling
from metric_base.arrays import grouped
from metric_base.folders import data_folder
from metric_tree.axes import DIMENSIONS
from metric_tree.node import AmbiguousName, Meaning, Node, NoPrior, UnknownName, node_of, require_tier
from metric_tree.prior import QUANTILES, Prior
from metric_tree.release.registry import release_directory
from metric_tree.release.release import Release, check_nodes, open_release
from taxonomy.naming.names import Names
from taxonomy.naming.resolver import Resolver
from taxonomy.words.senses import label_votes
from taxonomy.words.spelling import plain_fold, singular_phrases

if TYPE_CHECKING:
    from metric_tree.context import ContextModel
    from metric_tree.variants import Variant

#: Vocabulary of `find` and `resolve` that includes the label lists of all detectors.
DETECTORS = "detectors"
#: Maximum number of nodes in the message of an ambiguous name.
MAX_LISTED_NAMES = 4
#: Maximum length of a name in characters.
MAX_NAME_CHARS = 300
#: Characters of ids that are rare in names; texts without these characters are not looked up as former ids.
_ID_MARKS = frozenset(".:/")
_DIGIT = re.compile(r"\d")


def quantile_table(entries: Iterable[tuple[dict[str, Any], Prior | None]], labelled: bool = False) -> pa.Table:
    """Return a table of nodes with their sizes in mm; unknown dimensions are null.

    Parameters
    ----------
    entries : iterable of (dict, Prior or None)
        For each row `node_id`, `name`, `level`, `tier`, `n_items` if they are known, and the prior.
    labelled : bool
        Whether the rows have a `label`, as the first column.
    """
    types = {"node_id": pa.string(), "name": pa.string(), "level": pa.int8(), "tier": pa.string()}
    types |= {"n_items": pa.int64(), "n_sources": pa.int64()}
    fields = [pa.field("label", pa.string())] if labelled else []
    fields += [pa.field(name, kind) for name, kind in types.items()]
    columns = (f"{dim}_q{round(100 * q):02d}_mm" for dim in DIMENSIONS for q in QUANTILES)
    fields += [pa.field(name, pa.float64(), metadata={"unit": "mm"}) for name in columns]
    rows = []
    for facts, prior in entries:
        row = dict(facts)
        if prior is not None:
            row["n_sources"] = prior.n_sources
            for q, sizes in zip(QUANTILES, prior.quantiles(QUANTILES), strict=True):
                for dim, mm in zip(prior.dims, sizes, strict=True):
                    row[f"{dim}_q{round(100 * q):02d}_mm"] = float(f"{mm:.5g}")
        rows.append(row)
    return pa.Table.from_pylist(rows, schema=pa.schema(fields))


@cache
def _first_words_of_variants() -> frozenset[str]:
    """Return the first folded word of each name of a variant: `metric_tree.variants` takes a third of a query."""
    with (data_folder() / "curated" / "variants.csv").open(encoding="utf-8", newline="") as file:
        aliases = [alias for row in csv.DictReader(file) for alias in row["aliases"].split("; ")]
    return frozenset(plain_fold(alias).partition(" ")[0] for alias in aliases)


class Tree:
    """A release in memory. Nodes, priors and items are read on first use."""

    def __init__(self, release: Release) -> None:
        self.release: Release = release
        self._table = release.table("nodes")
        ids = self._table["node_id"].to_pylist()
        self._parents = self._table["parent_id"].to_pylist()  # by row
        check_nodes(ids, self._parents, release.directory)
        self._rows = {node_id: row for row, node_id in enumerate(ids)}
        self._nodes: dict[str, Node] = {}
        self._priors: dict[tuple[str, tuple[str, ...]], Prior] = {}

    def __repr__(self) -> str:
        return f"<Tree {self.name} {self.version}: {len(self)} nodes>"

    def __iter__(self) -> Iterator[Node]:
        if len(self._nodes) < len(self):  # one by one takes ten times as long
            for row in self._table.to_pylist():
                self._nodes.setdefault(row["node_id"], node_of(self, row))
        return (self._nodes[node_id] for node_id in self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, name: object) -> bool:
        """Return True if `find` returns a node for a name, or if a node is in the tree."""
        if isinstance(name, Node):
            return name.node_id in self._rows
        if not isinstance(name, str):
            return False
        match = self._resolver.match(name)
        return self.stated_meaning(name) is not None or (match is not None and not match.ambiguous)

    @property
    def name(self) -> str:
        """Name of the release."""
        return str(self.release.manifest["name"])

    @property
    def version(self) -> str:
        """Semantic version of the release."""
        return str(self.release.manifest["version"])

    @property
    def context_model(self) -> ContextModel | None:
        """Model of regions and years; None for an older release."""
        from metric_tree.context import ContextModel

        record = self.release.manifest.get("context_model")
        return ContextModel(**record) if record else None

    @property
    def root(self) -> Node:
        """Node of level 1."""
        return self.node(self._below[None][0])

    def leaves(self) -> tuple[Node, ...]:
        """Return the nodes without children."""
        return tuple(node for node in self if node.node_id not in self._below)

    def has_node(self, node_id: str) -> bool:
        """Return True if a node has this id."""
        return node_id in self._rows

    def node(self, node_id: str) -> Node:
        """Return the node with this current or former id. Raises UnknownName if there is none."""
        node_id = self._successors.get(node_id, node_id) if node_id not in self._rows else node_id
        if node_id not in self._rows:
            raise UnknownName(f"{node_id}: no node has this id")
        if node_id not in self._nodes:
            (row,) = self._table.slice(self._rows[node_id], 1).to_pylist()
            self._nodes.setdefault(node_id, node_of(self, row))
        return self._nodes[node_id]

    def children(self, node_id: str) -> tuple[Node, ...]:
        """Return the children of a node."""
        return tuple(self.node(child) for child in self._below.get(node_id, ()))

    def find(
        self, name: str, vocabulary: str | None = None, *, advice: bool = True, at_least: str | None = None
    ) -> Node:
        """Return the node of a name: an id, synset, name, alias, detector label or phrase; see `resolve`.

        Parameters
        ----------
        name : str
            Name to look up.
        vocabulary : str, optional
            Label list of the name.
        advice : bool
            Whether the error of an unknown name suggests similar names (slow).
        at_least : str, optional
            Minimum tier of the size (`metric_tree.tiers.TIERS`).

        Raises
        ------
        UnknownName
            The name has no node in the tree.
        AmbiguousName
            The name has several unrelated nodes with similar evidence: a bat is an animal and a stick.
        ThinEvidence
            The tier of the node is below `at_least`.

        >>> import metric_tree
        >>> tree = metric_tree.open()
        >>> tree.find("black wooden chairs").node_id
        'chair.n.01'
        """
        meaning = self.resolve(name, vocabulary, advice=advice)
        if meaning.ambiguous:
            rivals = (meaning.node, *meaning.alternatives)[:MAX_LISTED_NAMES]
            candidates = ", ".join(f"{node.node_id} ({node.n_items} items)" for node in rivals)
            raise AmbiguousName(f"{name!r} means several nodes: {candidates}; use the id of one of them")
        if at_least is not None:
            require_tier(meaning.node, at_least)
        return meaning.node

    def resolve(self, text: str, vocabulary: str | None = None, *, advice: bool = True) -> Meaning:
        """Return the node of a text, the rule that matched, the margin over other nodes, and the alternatives.

        Case, plurals, spaces, hyphens, underscores, articles, numbers and British spelling are normalised; adjectives,
        colours, materials and rooms are removed. A text with one wrong letter is matched; with more, it is unknown.

        Parameters
        ----------
        text : str
            Name to look up.
        vocabulary : str, optional
            Label list of the text; `detectors` includes all lists, the most used first.
        advice : bool
            Whether the error of an unknown name suggests similar names (slow).

        Raises
        ------
        UnknownName
            The text has no node in the tree.
        taxonomy.label_lists.UnknownLabel
            `vocabulary` is not a list, or the list does not contain the label.

        >>> import metric_tree
        >>> meaning = metric_tree.open().resolve("black mugs")
        >>> meaning.node.node_id, meaning.how
        ('mug.n.04', 'modifier stripped')
        """
        if not isinstance(text, str) or not text.strip():
            raise UnknownName(f"name: expected a name; found {text!r}")
        if len(text) > MAX_NAME_CHARS:
            raise UnknownName(f"no node is called {text[:40]!r}, with {len(text):,} characters in all")
        if vocabulary is not None and (listed := self._label_node(text, vocabulary)) is not None:
            return Meaning(listed, "label list", math.inf, (), False)
        if text not in self._rows and _ID_MARKS.intersection(text) and text in self._successors:
            return Meaning(self.node(text), "id", math.inf, (), False)
        if (stated := self.stated_meaning(text)) is not None:
            return stated
        match = self._resolver.match(text)
        if match is None:
            nearest = self._resolver.nearest(text) if advice else ()
            raise UnknownName(f"no node is called {text!r}{spelling.advice(nearest)}")
        nodes = [self.node(candidate.node_id) for candidate in match.candidates]
        node = replace(nodes[0], note=match.note) if match.how == "broader kind" else nodes[0]
        return Meaning(node, match.how, match.margin, tuple(nodes[1:]), match.ambiguous, match.note)

    def stated_meaning(self, text: str) -> Meaning | None:
        """Return the meaning of the name of a variant, or of a name with a size; None for other texts.

        >>> import metric_tree
        >>> metric_tree.open().stated_meaning("55 inch tv").node.stated.name
        '55 inch'
        """
        form, has_number = plain_fold(text), _DIGIT.search(text) is not None
        names = (form, *singular_phrases(form))
        if not has_number and not any(name.partition(" ")[0] in _first_words_of_variants() for name in names):
            return None
        from metric_tree.variants import named_variant, quantity_in

        variant = named_variant(text)
        if variant is not None and variant.node_id in self._rows:
            node = self.node(variant.node_id)
            origin = variant.norm or f"{variant.clause}, a {variant.document}"
            note = f"variant {variant.name} of {node.name}: {origin}"
            return Meaning(replace(node, stated=variant.stated, note=note), "variant", math.inf, (), False, note)
        if not has_number or self._resolver.is_name(text) or not (quantity := quantity_in(text)):
            return None
        match = self._resolver.match(quantity.rest)
        if match is None or match.ambiguous:
            return None
        node = self.node(match.node_id)
        stated = quantity.stated([node.node_id, *(above.node_id for above in node.ancestors())])
        if stated is None:
            return None
        note = "; ".join(filter(None, (match.note, f"{quantity.words}: {' and '.join(stated.sizes)} by its rule")))
        return Meaning(replace(node, stated=stated, note=note), match.how, match.margin, (), False, note)

    def variants(self, node: Node | str) -> tuple[Variant, ...]:
        """Return the named variants of a node or a name (`metric_tree.variants`), empty without any.

        >>> import metric_tree
        >>> len(metric_tree.open().variants("soda can")) > 2
        True
        """
        return (self.find(node) if isinstance(node, str) else node).variants

    def search(self, text: str, limit: int = 10) -> tuple[Node, ...]:
        """Return up to `limit` nodes for a partial or misspelt text, the most relevant first.

        Nodes of the text come first, then names that begin with it, then similar names. Texts longer than
        `MAX_NAME_CHARS` return no nodes.

        >>> import metric_tree
        >>> metric_tree.open().search("wardrob", limit=1)[0].name
        'wardrobe'
        """
        if len(text) > MAX_NAME_CHARS:
            return ()
        return tuple(self.node(node_id) for node_id in self._resolver.nodes_by_relevance(text, limit))

    def names(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield every normalised name with the ids of its nodes, the most likely first."""
        return self._resolver.names()

    def _label_node(self, text: str, vocabulary: str) -> Node | None:
        """Return the node of a label; None if no list of the detectors contains it."""
        if vocabulary == DETECTORS:
            known = (node_id for node_id in label_votes(plain_fold(text)) if node_id in self._rows)
            return next(map(self.node, known), None)
        from taxonomy.label_lists import UnknownLabel, labelled_node
        from taxonomy.label_lists import vocabulary as labels

        def likely_ids(name: str) -> tuple[str, ...]:
            match = self._resolver.match(name)
            return tuple(one.node_id for one in match.candidates) if match else ()

        node_id = labelled_node(text, vocabulary, likely_ids)
        if node_id in self._rows:
            stated = self.stated_meaning(text)
            return stated.node if stated is not None and stated.node.node_id == node_id else self.node(node_id)
        from taxonomy.words.senses import senses  # the closest hypernym in this release

        lemma = node_id.removeprefix("mt:").partition(".n.")[0].replace("_", " ")
        chains = (sense.chain for sense in senses(lemma) if sense.chain[:1] == (node_id,))
        hypernym = next((above for chain in chains for above in chain if above in self._rows), None)
        if hypernym is None and node_id not in self._successors:
            listed = (one.label for one in labels(vocabulary) if one.node_id in self._rows)
            nearest = self._resolver.nearest(text) or spelling.near_spellings(text, listed, n=MAX_LISTED_NAMES - 1)
            advice = spelling.advice(nearest)
            raise UnknownLabel(f"{text!r} of {vocabulary}: this release has no category for the label{advice}")
        return self.node(hypernym or node_id)

    def priors(self, vocabulary: str | None = None) -> pa.Table:
        """Return the quantiles in mm of every node, or of every label of a list, as a flat table.

        The columns are `node_id`, `name`, `level`, `tier`, `n_items`, `n_sources`, and the quantiles of the default
        prior, such as `length_q05_mm`. With a vocabulary, `label` comes first.

        >>> import metric_tree
        >>> table = metric_tree.open().priors(vocabulary="kitti_8")
        >>> table.column_names[:3], table.num_rows
        (['label', 'node_id', 'name'], 8)
        """
        if vocabulary is None:
            return quantile_table(map(self._size_entry, self))
        from taxonomy.label_lists import vocabulary as labels

        known = ((one.label, one.node_id if one.node_id in self._rows else None) for one in labels(vocabulary))
        entries = ((label, self._size_entry(self.node(node_id)) if node_id else ({}, None)) for label, node_id in known)
        return quantile_table((({"label": label, **facts}, prior) for label, (facts, prior) in entries), labelled=True)

    def _size_entry(self, node: Node) -> tuple[dict[str, Any], Prior | None]:
        """Return the columns of a node for a table, and its default prior or None."""
        prior = node.prior() if node.prior_dims else None
        return {name: getattr(node, name) for name in ("node_id", "name", "level", "tier", "n_items")}, prior

    def to_pandas(self, vocabulary: str | None = None) -> Any:
        """Return `priors` as a pandas DataFrame; it needs the extra `pandas`."""
        return self.priors(vocabulary).to_pandas()

    def prior_dims(self, node_id: str) -> tuple[tuple[str, ...], ...]:
        """Return the sets of dimensions for which a node has a row in the table of priors."""
        dims = self._prior_table["dims"]
        return tuple(tuple(dims[row].as_py()) for row in self._rows_of_priors.get(node_id, ()))

    def prior(self, node_id: str, dims: tuple[str, ...]) -> Prior:
        """Return the prior of a node over `dims`, from the row with the fewest dimensions that contains them.

        Raises
        ------
        NoPrior
            No row contains the dimensions.
        """
        prior = self._priors.get((node_id, dims))
        if prior is None:
            stated = self.prior_dims(node_id)
            rows = zip(stated, self._rows_of_priors.get(node_id, ()), strict=True)
            containing = [(len(row_dims), row) for row_dims, row in rows if set(dims) <= set(row_dims)]
            if not containing or not dims:
                exists = "; ".join(map(", ".join, stated)) or "none"
                wanted = ", ".join(dims) or "no dimension"
                raise NoPrior(f"{node_id}: dims: expected a prior that holds {wanted}; found {exists}")
            prior = Prior.of_row(self._prior_table.slice(min(containing)[1], 1).to_pylist()[0])
            prior = prior if prior.dims == dims else prior.marginal(dims)
            self._priors[node_id, dims] = prior
        return prior

    def tier(self, node_id: str) -> str | None:
        """Return the tier of a node; None for a node without a prior."""
        if (tier := self._tiers.get(node_id)) is not None:
            return tier
        dims = self.prior_dims(node_id)  # a release before 3.0.0
        return self.prior(node_id, dims[0]).tier if dims else None

    @cached_property
    def _prior_table(self) -> pa.Table:
        return self.release.table("priors")

    @cached_property
    def _rows_of_priors(self) -> dict[str, list[int]]:
        """Rows of the table of priors by node."""
        return grouped((node_id, row) for row, node_id in enumerate(self._prior_table["node_id"].to_pylist()))

    @cached_property
    def _successors(self) -> dict[str, str]:
        """Node of each id of an earlier release; empty if the release has no `successors.parquet`."""
        path = self.release.directory / "successors.parquet"
        if not path.is_file():
            return {}
        table = pq.ParquetFile(path).read()
        return dict(zip(table["old_id"].to_pylist(), table["node_id"].to_pylist(), strict=True))

    @cached_property
    def _tiers(self) -> dict[str, str | None]:
        """Tier by node; empty for a release before 3.0.0."""
        if "tier" not in self._table.column_names:
            return {}
        return dict(zip(self._rows, self._table["tier"].to_pylist(), strict=True))

    @cached_property
    def _below(self) -> dict[str | None, list[str]]:
        """Ids of the children of each node; the root is the child of None."""
        return grouped((self._parents[row], node_id) for node_id, row in self._rows.items())

    @cached_property
    def _resolver(self) -> Resolver:
        names, aliases, items = (self._table[column].to_pylist() for column in ("name", "aliases", "n_items"))
        return Resolver(Names([*self._rows], names, aliases, items, self._parents, lambda n: self.node(n).hypernyms))


def open_tree(ref: str | Path | None = None, licence: str | None = None) -> Tree:
    """Open the tree of the shipped release, of an available version, or of a folder.

    With `licence="open"` it is the tree that is fitted to sources with open licences alone; `metric-tree cite` states
    the sources of both.

    Raises
    ------
    metric_tree.release.release.BadRelease
        The release does not exist, is damaged, or has a schema that this version cannot read.

    Examples
    --------
    >>> import metric_tree
    >>> metric_tree.open().find("office chair").level
    5
    """
    directory = release_directory(ref, licence)
    states = ((file.name, file.stat()) for file in sorted(directory.glob("*.*")) if file.exists())
    return _opened_tree(directory, tuple((name, s.st_ino, s.st_mtime_ns, s.st_size) for name, s in states))


@lru_cache(maxsize=1)
def _opened_tree(directory: Path, _files: tuple[tuple[str, int, int, int], ...]) -> Tree:
    """Return the tree of a release, opened once for each state of its files.

    Estimates cache what they compute from its priors. A batch that opened it for each scene grew by 10 MB per scene.
    """
    return Tree(open_release(directory))
