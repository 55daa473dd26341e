"""`make test` runs every test file once, in parts of limited length, and fails if one of them fails."""

from __future__ import annotations

import json

import pytest

from tests import run
from tests.run import DURATIONS, MAX_PART_S, MIN_PART_S, NO_TESTS, ROOT, TESTS, counts, parts


def test_every_file_is_in_one_part() -> None:
    files = [path.relative_to(ROOT).as_posix() for path in TESTS.rglob("test_*.py")]
    found = parts(run.test_files(TESTS), json.loads(DURATIONS.read_text(encoding="utf-8")))
    assert sorted(file for part in found for file in part) == sorted(files)


@pytest.mark.parametrize(
    ("seconds", "lengths"),
    [
        ([0.4 * MAX_PART_S, 0.6 * MAX_PART_S], [2]),
        ([0.4 * MAX_PART_S, 0.6 * MAX_PART_S + 1, 1], [2, 1]),
        ([1.1 * MAX_PART_S, 1, 1], [1, 2]),
    ],
)
def test_a_part_is_within_the_limit_or_one_file(seconds: list[float], lengths: list[int]) -> None:
    files = [f"tests/a/test_{number}.py" for number in range(len(seconds))]
    assert [len(part) for part in parts(files, dict(zip(files, seconds, strict=True)))] == lengths


@pytest.mark.parametrize(("first_s", "n_parts"), [(MIN_PART_S, 2), (MIN_PART_S - 1, 1)])
def test_a_part_of_some_length_ends_with_its_package(first_s: float, n_parts: int) -> None:
    files = ["tests/a/test_1.py", "tests/b/test_2.py"]
    assert len(parts(files, {files[0]: first_s, files[1]: 1.0})) == n_parts


@pytest.mark.parametrize(
    ("output", "numbers"),
    [
        ("== 1 failed, 3 passed, 2 skipped in 1.20s ==", {"failed": 1, "passed": 3, "skipped": 2}),
        ("a\n3 passed in 61.20s (0:01:01)", {"passed": 3}),
        ("no tests ran in 0.01s", {}),
        ("Segmentation fault", {}),
    ],
)
def test_numbers_of_the_last_line_are_read(output: str, numbers: dict[str, int]) -> None:
    assert dict(counts(output)) == numbers


@pytest.mark.parametrize(
    ("results", "status"),
    [([0, 0], 0), ([0, NO_TESTS], 0), ([1, 0], 1), ([0, -11], 1)],
)
def test_a_failed_part_fails_the_run(
    results: list[int], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = ["tests/fuzz/test_fuzz.py", "tests/project/test_data.py"]
    monkeypatch.setattr(run, "MAX_PART_S", 0.0)
    monkeypatch.setattr(run, "run", lambda command: (results[files.index(command[-1])], f"of {command[-1]}"))
    assert run.main([str(ROOT / file) for file in files]) == status
    printed = capsys.readouterr().out
    assert [file for file in files if f"FAILED {file}" in printed] == [
        file for file, result in zip(files, results, strict=True) if result not in (0, NO_TESTS)
    ]


def test_a_command_that_does_not_end_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "PART_TIMEOUT_S", 0.1)
    status, output = run.run(["sleep", "60"])
    assert status == 1
    assert output.endswith("not finished after 0 s")
