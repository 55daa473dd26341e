"""Tab completion of the three programs, in the shell itself; and the outline of a release in the terminal."""

from __future__ import annotations

import json
import subprocess

import pytest

from metric_cli.estimate_scale.estimate import main as estimate_scale
from metric_cli.insert_object.insert import main as insert_object
from metric_cli.subcommands import SUBCOMMANDS, main


@pytest.fixture(scope="module")
def scripts() -> dict[str, str]:
    """The bash script of each program."""
    import contextlib
    import io

    made = {}
    for name, program in (("metric-tree", main), ("estimate-scale", estimate_scale), ("insert-object", insert_object)):
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            program(["--completion", "bash"])
        made[name] = text.getvalue()
    return made


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["metric-tree", "que"], {"query"}),
        (["metric-tree", "diff", "--fail"], {"--fail-over"}),
        (["metric-tree", "list", "--d"], {"--depth"}),
        (["metric-tree", "--vers"], {"--version"}),
        (["estimate-scale", "--view-"], {"--view-png", "--view-glb"}),
        (["insert-object", "--rend"], {"--renderer"}),
        (["estimate-scale", "pypro"], {"pyproject.toml"}),
    ],
)
def test_bash_completes(scripts: dict[str, str], words: list[str], expected: set[str]) -> None:
    function = f"_{words[0].replace('-', '_')}"
    code = (
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; {function}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    done = subprocess.run(
        ["bash", "-c", scripts[words[0]] + code], capture_output=True, text=True, check=True, timeout=300
    )
    assert set(done.stdout.split()) == expected


def test_other_shells_name_every_subcommand(capsys: pytest.CaptureFixture[str]) -> None:
    for shell in ("zsh", "fish"):
        assert main(["--completion", shell]) == 0
        text = capsys.readouterr().out
        assert all(subcommand in text for subcommand in SUBCOMMANDS)
    assert "__fish_seen_subcommand_from diff' -l fail-over" in text


def test_the_outline_of_a_release(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--tree", "--depth", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("entity  ")
    assert all(line.startswith(("├─ ", "└─ ")) for line in lines[1:])
    assert main(["list", "--below", "chair", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows[0]["node"] == "chair.n.01"
    assert {row["parent"] for row in rows[1:]} <= {row["node"] for row in rows}
    assert main(["list", "--tree", "--depth", "9"]) == 2
