"""A build of synthetic items with two processes: `python -m tests.support.small_build RAW OUT`.

With `I/N`, only step 1 of a part, in this process; with an empty text and an address, on a Dask
scheduler. RAW may be a URL of S3.
"""

from __future__ import annotations

import sys
from pathlib import Path

from metric_base.executors import executor_of
from metric_tree.pipeline import ingest
from metric_tree.pipeline.build import BuildOptions, build_release, ingest_part
from tests.synthetic.raw_fixture import SOURCES
from tests.synthetic.small_taxonomy import small_taxonomy

#: Size of a block in bytes: the items of a test are several blocks.
BLOCK_BYTES = 20_000
OPTIONS = BuildOptions(version="0.0.1", created="2026-11-21", heldout=False)


def main(raw: str, out: str, part: str = "", scheduler: str = "", block_bytes: str = "") -> None:
    ingest.BLOCK_BYTES = int(block_bytes or BLOCK_BYTES)
    if part:
        index, n_parts = map(int, part.split("/"))
        ingest_part([Path(raw)], Path(out), OPTIONS, (index, n_parts), taxonomy=small_taxonomy, declared=SOURCES)
        return
    with executor_of(2, scheduler or None) as executor:
        build_release([Path(raw)], Path(out), OPTIONS, taxonomy=small_taxonomy, declared=SOURCES, executor=executor)


if __name__ == "__main__":
    main(*sys.argv[1:])
