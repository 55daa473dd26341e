"""How many threads a program takes for the products of matrices."""

from __future__ import annotations

import os

import pytest

from metric_cli.programs import THREAD_VARIABLES
from metric_cli.subcommands import main


@pytest.mark.parametrize("given", [None, *THREAD_VARIABLES])
def test_one_thread_unless_the_user_says_so(
    given: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A build over several threads ends in other last bits than the release that ships."""
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    if given is not None:
        monkeypatch.setenv(given, "3")
    assert main([]) == 0
    assert "SUBCOMMAND" in capsys.readouterr().out
    found = {name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ}
    assert found == ({THREAD_VARIABLES[0]: "1"} if given is None else {given: "3"})
