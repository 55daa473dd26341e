"""A page for an hour of proofreading: the most used nodes that rest on little, with a form for better ranges.

What the reader saves are rows of `data/curated/ranges.csv` under the reader's name; a person's row outranks a program's
(`metric_tree.curated.sizes`). The page is one file and sends nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

from metric_tree.axes import AXES
from metric_tree.curated.sizes import curated_ranges
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.report.html import plain, whole_page
from metric_tree.tiers import TIERS, tier_words
from metric_tree.tree import Node, Tree
from taxonomy.words.senses import node_uses

__all__ = ["proofreading_page", "thin_nodes"]

#: What a size that needs no proofreading rests on.
SOUND = ("norm", "measured")

#: The quantiles that a range is: nine of ten lie between the outer two.

_ENDS = ("low", "typical", "high")

_SCRIPT = """
const fields = [...document.querySelectorAll("tr[data-node]")]
const quoted = text => '"' + text.replaceAll('"', '""') + '"'
document.getElementById("save").addEventListener("click", () => {
  const name = document.getElementById("reviewer").value.trim()
  if (!name || name.startsWith("program")) { alert("Your name comes first."); return }
  const day = new Date().toISOString().slice(0, 10)
  const lines = fields.filter(row => row.querySelector("select").value).map(row => {
    const cells = [...row.querySelectorAll("input[type=number]")].map(cell => cell.value)
    const why = row.querySelector("input[type=text]").value || row.querySelector("select").value
    return [row.dataset.node, ...cells, quoted(why), quoted(name), day].join(",")
  })
  const link = document.createElement("a")
  link.href = URL.createObjectURL(new Blob([lines.join("\\n") + "\\n"], { type: "text/csv" }))
  link.download = "ranges-" + day + ".csv"
  link.click()
})
"""


def thin_nodes(tree: Tree, limit: int) -> list[Node]:
    """The `limit` most used leaves that rest on few items or less, the thinnest evidence first."""
    uses = node_uses()
    thin = [node for node in tree.leaves() if node.prior_dims and node.tier not in SOUND and _use(node, uses)]
    used = sorted(thin, key=lambda node: (-_use(node, uses), node.node_id))[:limit]
    return sorted(used, key=lambda node: (-TIERS.index(node.tier or TIERS[-1]), -_use(node, uses), node.node_id))


def proofreading_page(tree: Tree, limit: int) -> str:
    """The page (HTML) for the `limit` most used nodes with thin evidence."""
    nodes = thin_nodes(tree, limit)
    note = (
        f"{len(nodes)} of the most used categories whose size rests on few items or less, the thinnest evidence first."
        " Sizes are in mm in the ordinary pose: nine of ten objects lie between low and high. Say of each whether it is"
        " right, and correct the numbers where it is not. What you save are rows to append to data/curated/ranges.csv."
    )
    head = "".join(f"<th>{plain(axis)} {end}</th>" for axis in AXES for end in _ENDS)
    table = (
        f"<table><tr><th>category</th><th>rests on</th>{head}<th>it is</th><th>why</th></tr>"
        f"{''.join(map(_row, nodes))}</table>"
    )
    name = '<p><label>Your name: <input id="reviewer"></label> <button id="save">Save as CSV</button></p>'
    content = f'{name}<div class="table">{table}</div><script>{_SCRIPT}</script>'
    return whole_page(f"{tree.name} {tree.version}: an hour of proofreading", note, [("Sizes", content)])


def _row(node: Node) -> str:
    prior = node.prior(node.prior_dims[0])
    evidence = prior.evidence
    counts = f"{evidence.rows:.0f} items of {evidence.sources} sources, {evidence.models} models" if evidence else ""
    cells = "".join(
        f'<td><input type="number" step="any" min="0" size="7" value="{value}" aria-label="{axis} {end}"></td>'
        for axis, values in zip(AXES, _ranges(node), strict=True)
        for end, value in zip(_ENDS, values, strict=True)
    )
    choices = '<option value=""></option>' + "".join(f"<option>{word}</option>" for word in ("right", "corrected"))
    return (
        f'<tr data-node="{plain(node.node_id)}"><td>{plain(node.name)}<br><small>{plain(" > ".join(node.path[1:-1]))}'
        f"</small></td><td>{plain(tier_words(node.tier or TIERS[-1]))}<br><small>{plain(counts)}</small></td>{cells}"
        f'<td><select aria-label="verdict">{choices}</select></td><td><input type="text" aria-label="why"></td></tr>'
    )


def _ranges(node: Node) -> Sequence[tuple[str, ...]]:
    """Low, typical and high of length, width and height as text; empty where the node has no such axis.

    A range that was written is shown as it was: the published interval is wider, as written ranges turned out too
    narrow, and a reader's word is a range again.
    """
    written = next((one for one in curated_ranges() if one.node_id == node.node_id), None)
    if written is not None:
        ends = zip(written.low, written.typical, written.high, strict=True)
        return [tuple("" if end is None else f"{end:.4g}" for end in axis) for axis in ends]
    prior = node.prior(node.prior_dims[0])
    quantiles = [prior.quantile(q) for q in INTERVAL_QUANTILES]
    names = AXES if prior.dims[0] in AXES else tuple(f"extent{number}" for number in (1, 2, 3))
    places = {dim: place for place, dim in enumerate(prior.dims)}
    return [
        tuple(f"{quantile[places[name]]:.4g}" for quantile in quantiles) if name in places else ("", "", "")
        for name in names
    ]


def _use(node: Node, uses: dict[str, float]) -> float:
    return uses.get(node.node_id, uses.get(node.node_id.removesuffix("/other"), 0.0))
