"""Arrow schemas of a release (`metric-tree/1`): every column with its unit and its meaning."""

from __future__ import annotations

import pyarrow as pa

from metric_tree.prior import SHARED_KINDS

SCHEMA = "metric-tree/1"


def _column(name: str, kind: pa.DataType, meaning: str, unit: str | None = None) -> pa.Field:
    metadata = {"meaning": meaning} | ({"unit": unit} if unit else {})
    return pa.field(name, kind, metadata=metadata)


_STRINGS = pa.list_(pa.string())
_NUMBERS = pa.list_(pa.float64())
_MATRIX = pa.list_(_NUMBERS)

#: Of each context the source, a country or region, the mean year, the offset (d,) and its sampling variance (d,).
_CONTEXTS = pa.list_(
    pa.struct(
        [
            ("source", pa.string()),
            ("region", pa.string()),
            ("year", pa.float64()),
            ("offset", _NUMBERS),
            ("variance", _NUMBERS),
        ]
    )
)

#: Share of each kind of evidence; releases before 3.0.0 have pairs of kind and share.
_SHARES = pa.struct([(kind, pa.float64()) for kind in SHARED_KINDS])
_EVIDENCE = pa.struct([("rows", pa.float64()), ("sources", pa.int64()), ("models", pa.int64()), ("ranges", pa.int64())])

NODES = pa.schema(
    [
        _column("node_id", pa.string(), "WordNet synset, mt:<name> for a reviewed insertion, or <id>/other"),
        _column("name", pa.string(), "what a reviewer calls it"),
        _column("synset", pa.string(), "WordNet 3.0 synset, null for an insertion"),
        _column("parent_id", pa.string(), "node above, null at the root"),
        _column("level", pa.int8(), "1 root ... 5 leaf"),
        _column("path", _STRINGS, "names from the root to the node"),
        _column("hypernyms", _STRINGS, "all synsets above it in WordNet"),
        _column("aliases", _STRINGS, "lemmas, spellings, detector labels"),
        _column("pose", pa.string(), "ordinary pose: upright, flat or any"),
        _column("dims", _STRINGS, "what to use as a prior by default"),
        _column("n_items", pa.int64(), "items of the fit at or below the node"),
        _column("n_own", pa.int64(), "items of the fit on the node itself"),
        _column(
            "tier", pa.string(), "what its size rests on: norm, measured, few, models, borrowed or judged; or null"
        ),
    ],
    metadata={"schema": SCHEMA},
)

ITEMS = pa.schema(
    [
        _column("item_id", pa.string(), "<source>:<source_id>"),
        _column("node_id", pa.string(), "leaf the item hangs on"),
        _column("source", pa.string(), "source id in the manifest"),
        _column("source_id", pa.string(), "the source's own id"),
        _column("title", pa.string(), "the source's own title"),
        _column("length_mm", pa.float64(), "longer horizontal extent in the ordinary pose", "mm"),
        _column("width_mm", pa.float64(), "shorter horizontal extent in the ordinary pose", "mm"),
        _column("height_mm", pa.float64(), "vertical extent in the ordinary pose", "mm"),
        _column("extents_mm", _NUMBERS, "every stated outer size, longest first", "mm"),
        _column("kind", pa.string(), "product, measured, standard, norm, asset, museum, judged or default"),
        _column("year", pa.int32(), "year of the item where the source knows it"),
        _column("region", pa.string(), "ISO 3166 code or market of the item where the source knows it"),
        _column("url", pa.string(), "page or file of the item"),
        _column("licence", pa.string(), "terms of the data's origin"),
        _column("flags", _STRINGS, "doubts of reviewers and checks"),
    ],
    metadata={"schema": SCHEMA},
)

PRIORS = pa.schema(
    [
        _column("node_id", pa.string(), "node of the prior"),
        _column("dims", _STRINGS, "subset of length, width, height, or of extent1, extent2, extent3"),
        _column("family", pa.string(), "lognormal-mixture"),
        _column("weights", _NUMBERS, "(k,) mixture weights, sum 1"),
        _column("means", _MATRIX, "(k, d) component means within a source", "ln mm"),
        _column("covariances", pa.list_(_MATRIX), "(k, d, d) component covariances within a source", "ln mm ^2"),
        _column("shared_covariance", _MATRIX, "(d, d) covariance between sources", "ln mm ^2"),
        _column("n", pa.int64(), "items of the fit after duplicates are collapsed"),
        _column("n_sources", pa.int64(), "sources of these items"),
        _column("share_by_kind", _SHARES, "share of the fit's weight by kind, null of none"),
        _column("borrowed", pa.float64(), "share taken from the parent, 0 to 1"),
        _column("heldout_log_density", pa.float64(), "mean held-out log density over log mm, or null"),
        _column("sameness", pa.float64(), "share of the variance within a source that one room shares, or null"),
        _column("sameness_sd", pa.float64(), "standard deviation of that share, or null"),
        _column("contexts", _CONTEXTS, "offsets from the class's centre by source, region and years", "ln mm"),
        _column("tier", pa.string(), "what the size rests on: norm, measured, few, models, borrowed or judged"),
        _column("evidence", _EVIDENCE, "the counts behind the tier"),
        _column("norm", pa.string(), "document and clause that fix the size, or null"),
    ],
    metadata={"schema": SCHEMA},
)

IMAGES = pa.schema(
    [
        _column("image_id", pa.string(), "sha256 of the bytes"),
        _column("item_id", pa.string(), "item it shows"),
        _column("node_id", pa.string(), "leaf of the item"),
        _column("path", pa.string(), "file inside the release, null where only the link may be kept"),
        _column("cutout_path", pa.string(), "RGBA foreground cut, null before `cutout`"),
        _column("width_px", pa.int32(), "width", "px"),
        _column("height_px", pa.int32(), "height", "px"),
        _column("foreground_share", pa.float64(), "foreground pixels over all, null before `cutout`"),
        _column("method", pa.string(), "how the foreground was cut"),
        _column("source_url", pa.string(), "where the picture came from"),
        _column("licence", pa.string(), "terms of the picture"),
        _column("attribution", pa.string(), "whom to name, null where the source's own attribution holds"),
        _column("pixels_per_metre", pa.float64(), "scale of an orthographic picture, else null", "px/m"),
    ],
    metadata={"schema": SCHEMA},
)

#: Columns of `successors.parquet`.
SUCCESSORS = pa.schema([("old_id", pa.string()), ("release", pa.string()), ("node_id", pa.string())])

#: Columns that were added within version 1: a release that is older lacks them, which is no error.
ADDED_COLUMNS = frozenset(
    {"attribution", "pixels_per_metre", "sameness", "sameness_sd", "contexts", "tier", "evidence", "norm"}
)

#: Types that a column had in releases before 3.0.0, which are read all the same.
FORMER_TYPES = {"share_by_kind": pa.map_(pa.string(), pa.float64())}

#: The tables of a release by file name; a release has exactly these beside its manifest.
TABLES = {"nodes.parquet": NODES, "items.parquet": ITEMS, "priors.parquet": PRIORS, "images.parquet": IMAGES}
