"""Fuzz a reader with guidance by coverage (Atheris): inputs that reach new code are stored and mutated further.

    python -m tests.fuzz.guided READER SEEDS CORPUS SECONDS COUNTS

Half of the mutations are libFuzzer's, half are ours (`mutations`). An input is one byte with the index of the file that
it replaces, followed by the content. The counts are written to the file COUNTS during the run, so that they survive a
crash of a decoder.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["metric_base", "crawler", "taxonomy", "metric_tree", "models3d", "estimator", "capture", "insertion"]
):
    from tests.fuzz.mutations import mutated
    from tests.fuzz.outcomes import KEPT, Bench, bound_memory, peak_mib
    from tests.fuzz.readers import READERS

import numpy as np

#: Interval in seconds at which the counts are written.
WRITE_INTERVAL_S = 2.0
#: Maximum size of an input relative to the largest intact file.
MAX_GROWTH = 3


def main(name: str, seeds: Path, corpus: Path, seconds: float, counts_file: Path) -> None:
    """Fuzz for `seconds`, then end the process."""
    warnings.simplefilter("ignore")
    bound_memory()
    reader = next(reader for reader in READERS if reader.name == name)
    temporary = tempfile.TemporaryDirectory()
    bench = Bench(reader, seeds, Path(temporary.name), KEPT)
    bench.run_intact()
    corpus.mkdir(parents=True, exist_ok=True)
    for index, content in enumerate(bench.intact):
        (corpus / f"whole-{index}").write_bytes(bytes([index]) + content)
    last, end = 0.0, time.monotonic() + seconds

    def write_counts() -> None:
        part = counts_file.with_suffix(".part")
        part.write_text(json.dumps({**bench.counts, "peak MiB": peak_mib()}))
        part.replace(counts_file)

    def test(data: bytes) -> None:
        nonlocal last
        if data:
            bench.run(data[0] % len(bench.files), data[1:])
        now = time.monotonic()
        if now - last > WRITE_INTERVAL_S or now > end:
            last = now
            write_counts()
        if now > end:
            temporary.cleanup()
            os._exit(0)

    def mutate(data: bytes, max_bytes: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        index, content = (data[:1], data[1:]) if data else (b"\0", bench.intact[0])
        if rng.random() < 0.5:
            return (index + mutated(content, rng))[:max_bytes]
        return index + atheris.Mutate(content, max(max_bytes - 1, 1))  # type: ignore[no-any-return]

    max_input = MAX_GROWTH * max(map(len, bench.intact)) + 1000
    flags = ["-verbosity=0", "-rss_limit_mb=0", "-timeout=600", f"-max_len={max_input}", "-len_control=0", str(corpus)]
    atheris.Setup([sys.argv[0], *flags], test, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]), Path(sys.argv[5]))
