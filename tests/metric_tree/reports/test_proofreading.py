"""The page for proofreading: thin and used nodes, and numbers that are the priors' own."""

from __future__ import annotations

import re
from pathlib import Path

from explorer.pages.proofreading_page import SOUND, thin_nodes
from metric_cli.subcommands import main
from metric_tree.tiers import TIERS
from metric_tree.tree import open_tree
from taxonomy.words.senses import node_uses


def test_the_page_has_the_most_used_thin_nodes_with_their_own_numbers(tmp_path: Path, capsys) -> None:
    tree = open_tree()
    nodes = thin_nodes(tree, 12)
    assert len(nodes) == 12
    assert all(node.tier not in SOUND for node in nodes)
    ranks = [TIERS.index(node.tier or "judged") for node in nodes]
    assert ranks == sorted(ranks, reverse=True)
    least = min(node_uses().get(node.node_id.removesuffix("/other"), 0.0) for node in nodes)
    rest = [n for n in tree.leaves() if n.tier not in SOUND and n not in nodes and n.prior_dims]
    assert least >= max(node_uses().get(n.node_id, 0.0) for n in rest)
    assert main(["review", "proof", "--out", str(tmp_path / "p.html"), "--limit", "12"]) == 0
    page = (tmp_path / "p.html").read_text()
    assert re.findall(r'data-node="([^"]+)"', page) == [node.node_id for node in nodes]
    first = nodes[0].prior(nodes[0].prior_dims[0]).quantile(0.5)[0]
    assert f'value="{first:.4g}"' in page
    assert main(["review", "proof", "--out", str(tmp_path / "q.html"), "--limit", "0"]) == 2
    assert "--limit" in capsys.readouterr().err
