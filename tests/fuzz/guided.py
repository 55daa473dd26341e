"""One reader, fuzzed with guidance by coverage (Atheris): inputs that reach new code are kept and mutated further.

    python -m tests.fuzz.guided READER SEEDS CORPUS SECONDS ANSWER

Half of the mutations are libFuzzer's, half ours (`mutations`). An input is the number of the file that it stands in
place of, one byte, and the file. What was counted is written to ANSWER while it runs, so that a crash of a decoder
loses nothing.
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

#: Seconds between two writings of what was counted.
EVERY = 2.0
#: Largest input over the largest whole file.
GROWTH = 3


def main(name: str, seeds: Path, corpus: Path, seconds: float, answer: Path) -> None:
    """Fuzz until the time is up; the process ends here."""
    warnings.simplefilter("ignore")
    bound_memory()
    reader = next(reader for reader in READERS if reader.name == name)
    temporary = tempfile.TemporaryDirectory()
    bench = Bench(reader, seeds, Path(temporary.name), KEPT)
    bench.run_whole()
    corpus.mkdir(parents=True, exist_ok=True)
    for number, whole in enumerate(bench.whole):
        (corpus / f"whole-{number}").write_bytes(bytes([number]) + whole)
    last, end = 0.0, time.monotonic() + seconds

    def write_answer() -> None:
        part = answer.with_suffix(".part")
        part.write_text(json.dumps({**bench.counts, "peak MiB": peak_mib()}))
        part.replace(answer)

    def test(data: bytes) -> None:
        nonlocal last
        if data:
            bench.run(data[0] % len(bench.files), data[1:])
        now = time.monotonic()
        if now - last > EVERY or now > end:
            last = now
            write_answer()
        if now > end:
            temporary.cleanup()
            os._exit(0)

    def mutate(data: bytes, most: int, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        number, whole = (data[:1], data[1:]) if data else (b"\0", bench.whole[0])
        if rng.random() < 0.5:
            return (number + mutated(whole, rng))[:most]
        return number + atheris.Mutate(whole, max(most - 1, 1))  # type: ignore[no-any-return]

    longest = GROWTH * max(map(len, bench.whole)) + 1000
    flags = ["-verbosity=0", "-rss_limit_mb=0", "-timeout=600", f"-max_len={longest}", "-len_control=0", str(corpus)]
    atheris.Setup([sys.argv[0], *flags], test, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]), Path(sys.argv[5]))
