"""Skip tests if an optional program or data set is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

__all__ = ["skip_without"]


@contextmanager
def skip_without(missing: type[Exception]) -> Iterator[None]:
    """Skip the test if the block raises `missing`, such as `NoOpenGL` or `NoWordNet`, which names the packages."""
    try:
        yield
    except missing as error:
        pytest.skip(f"a requirement of the test is missing: {error}")
