"""Tests that need what a machine may lack are skipped with a reason that says what, and how to get it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

__all__ = ["skip_without"]


@contextmanager
def skip_without(missing: type[Exception]) -> Iterator[None]:
    """Skip where the block raises `missing`, such as `NoOpenGL` or `NoWordNet`; its message names the packages."""
    try:
        yield
    except missing as error:
        pytest.skip(f"this machine lacks what the test needs: {error}")
