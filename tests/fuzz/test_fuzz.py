"""A short run of the fuzzing (`make fuzz` is the long one), and the inputs that once did harm."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.outcomes import Bench, fuzz
from tests.fuzz.reader import Reader
from tests.fuzz.readers import READERS, write_seeds

#: Inputs that once did harm: `<reader>--<file of the seed>`, with a number between them where there are more.
CORPUS = Path(__file__).parent / "corpus"


@pytest.fixture(scope="module")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    write_seeds(folder)
    return folder


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_whole_files_are_taken_and_damaged_ones_do_no_harm(reader: Reader, seeds: Path, tmp_path: Path) -> None:
    assert Bench(reader, seeds, tmp_path, None).run_whole() == {"taken"}
    counts = fuzz(reader, seeds, seconds=0.5, most=25, seed=7)
    assert counts["taken"] + counts["refused"] == counts["inputs"] > 0


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("file", sorted(CORPUS.glob("*--*")), ids=lambda file: file.name)
def test_what_once_did_harm(file: Path, seeds: Path, tmp_path: Path) -> None:
    name, *_, part = file.name.split("--")
    bench = Bench(next(reader for reader in READERS if reader.name == name), seeds, tmp_path, None)
    (number,) = (row for row, target in enumerate(bench.files) if target.name == part)
    assert bench.run(number, file.read_bytes()).partition(":")[0] in {"taken", "refused"}
