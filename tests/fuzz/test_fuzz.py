"""A short run of the fuzzing (`make fuzz` is the long run), and inputs that caused failures in the past."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.outcomes import Bench, fuzz
from tests.fuzz.reader import Reader
from tests.fuzz.readers import READERS, write_seeds

#: Inputs of past failures, named `<reader>--<file of the seed>` or `<reader>--<number>--<file of the seed>`.
CORPUS = Path(__file__).parent / "corpus"


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    write_seeds(folder)
    return folder


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_intact_files_are_accepted_and_damaged_files_cause_no_failure(
    reader: Reader, seeds: Path, tmp_path: Path
) -> None:
    assert Bench(reader, seeds, tmp_path, None).run_intact() == {"taken"}
    counts = fuzz(reader, seeds, seconds=0.5, max_inputs=25, seed=7)
    assert counts["taken"] + counts["refused"] == counts["inputs"] > 0


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("file", sorted(CORPUS.glob("*--*")), ids=lambda file: file.name)
def test_input_of_a_past_failure_is_accepted_or_refused(file: Path, seeds: Path, tmp_path: Path) -> None:
    name, *_, part = file.name.split("--")
    bench = Bench(next(reader for reader in READERS if reader.name == name), seeds, tmp_path, None)
    (index,) = (row for row, target in enumerate(bench.files) if target.name == part)
    assert bench.run(index, file.read_bytes()).partition(":")[0] in {"taken", "refused"}
