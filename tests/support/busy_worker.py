"""Worker process that never ends: `python -m tests.support.busy_worker busy REQUEST PARENT SECONDS`."""

from __future__ import annotations

import sys
from typing import Any

from capture.mapping.colmap_worker import Request, run_step


def busy(request: Request) -> dict[str, Any]:
    """Loop forever."""
    while True:
        pass


if __name__ == "__main__":
    run_step(sys.argv[1:], {"busy": busy})
