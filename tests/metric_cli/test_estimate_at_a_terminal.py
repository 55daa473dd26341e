"""`estimate-scale` at a terminal: its options and their completion, its table, pipes and threads."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from metric_cli.estimate_scale.estimate import main
from tests.metric_cli.test_estimate import CHAIR, STOOL, estimate, objects_file
from tests.support.processes import started


def test_help_names_every_option_of_the_contract(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--help", "all"])
    shown = capsys.readouterr().out
    assert stop.value.code == 0
    options = "SCENE --instances --categories --dense --tree --method --known-length --level --json --output --figure"
    for option in [*options.split(), "--overlay", "--write-scaled", "--objects"]:
        assert option in shown


def test_help_fits_on_two_screens_and_names_its_topics(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")

    def shown(*topic: str) -> str:
        with pytest.raises(SystemExit):
            main(["--help", *topic])
        return capsys.readouterr().out

    frequent = shown()
    assert len(frequent.splitlines()) <= 48
    assert max(map(len, frequent.splitlines())) <= 80
    topics = re.findall(r"[a-z]+", frequent.partition("those of a topic:")[2].partition("all")[0])
    assert topics == ["objects", "reconstruction", "result", "estimate", "evidence", "batch"]
    options = {name for topic in topics for name in re.findall(r"^  (--[a-z-]+)", shown(topic), re.MULTILINE)}
    assert options | {"--completion", "--version", "--overwrite"} == set(
        re.findall(r"^  (?:-h \[TOPIC\], )?(--(?!help)[a-z-]+)", shown("all"), re.MULTILINE)
    )


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ("s.json --detector auto --instances m.json --json", "estimate-scale s.json --detector auto --json"),
        (
            "s --method paper --known-length 0,0,0 1,0,0 2 --json",
            "estimate-scale s --known-length 0,0,0 1,0,0 2 --json",
        ),
        ("s --frames=9 --draw --objects o.json", "estimate-scale s --frames=9 --draw"),
        ("--json", "estimate-scale --json SCENE"),
        ("data/scenes/demo_room --frames 9 --json", "estimate-scale data/scenes/demo_room --json"),
    ],
)
def test_options_that_do_not_go_together_have_a_corrected_command(
    words: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert f"; try: {command}\n" in capsys.readouterr().err


def test_a_view_without_a_display_is_an_image(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    scene = Path("data/scenes/lund_street").resolve()
    monkeypatch.chdir(tmp_path)
    assert main([str(scene), "--view", "--quiet"]) == 0
    assert "there is no display; the view is written to view.png" in capsys.readouterr().err
    assert (tmp_path / "view.png").read_bytes().startswith(b"\x89PNG")
    assert main([str(scene), "--view"]) == 2
    assert "--view: view.png already exists" in capsys.readouterr().err


def test_a_reader_may_leave(tmp_path: Path, tree: Path) -> None:
    """`estimate-scale ... | head -1` ends quietly."""
    objects = objects_file(tmp_path, *({"category": "swivel chair", "dimensions": CHAIR} for _ in range(400)))
    code = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "--objects", str(objects), "--tree", str(tree), "--json"]
    with started(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        err = process.stderr.read()
    assert "Traceback" not in err
    assert "BrokenPipe" not in err


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OMP_NUM_THREADS": "2"}, None)])
def test_one_thread_unless_the_user_says_otherwise(
    tmp_path: Path, tree: Path, given: dict[str, str], expected: str | None
) -> None:
    """The variable is set before NumPy is loaded, and only where none of its kind is set.

    Nor does `--objects` load cv2, pycolmap, SciPy, scikit-learn or matplotlib.
    """
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    code = (
        "import os, sys; from metric_cli.estimate_scale.estimate import main;"
        "early = 'numpy' in sys.modules; main(sys.argv[1:]);"
        "heavy = {'cv2', 'pycolmap', 'scipy', 'sklearn', 'matplotlib', 'nltk', 'scrapy', 'open3d', 'pandas'};"
        "loaded = sorted(heavy & set(sys.modules));"
        "sys.stderr.write(repr((early, os.environ.get('OPENBLAS_NUM_THREADS'), loaded)))"
    )
    clean = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", code, "--objects", str(objects), "--tree", str(tree)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300, env=clean | given)
    assert (done.returncode, done.stderr) == (0, repr((False, expected, [])))


@pytest.mark.parametrize("columns", [80, 100, 120])
def test_the_table_fits_and_loses_no_word(
    columns: int, tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    giant = {name: 40 * value for name, value in STOOL.items()}
    objects = objects_file(
        tmp_path,
        {"id": "the one by the window on the left", "category": "swivel chair", "dimensions": CHAIR},
        {"id": "b", "category": "bar stool", "dimensions": STOOL},
        {"id": "c", "category": "bar stool", "dimensions": giant},
        {"id": "d", "category": "unicorn", "dimensions": STOOL},
    )
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree)
    assert status == 0
    assert max(map(len, out.splitlines())) <= columns
    record = json.loads(estimate(capsys, "--objects", objects, "--tree", tree, "--json")[1])
    shown = out.split()
    for item in record["objects"]:
        assert item["verdict"] in {word.strip(":") for word in shown}
        words = f"{item['id']} {item['category']} {item['reason'] or ''}".split()
        assert [word for word in words if word not in shown] == []
    assert "swivel_chair.n.01" not in out
    head = next(line.split() for line in out.splitlines() if line.split()[:1] == ["object"])
    assert head.index("tier") < head.index("metres"), "the evidence of a size is printed before the number"
    assert {item["tier"] for item in record["objects"] if item["verdict"] == "used"} <= set(shown)
    assert "swivel_chair.n.01" in estimate(capsys, "--objects", objects, "--tree", tree, "--wide")[1]


def test_objects_from_standard_input(tmp_path: Path, tree: Path) -> None:
    objects = objects_file(tmp_path, {"id": "a", "category": "swivel chair", "dimensions": CHAIR})
    body = "import sys; from metric_cli.estimate_scale.estimate import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", body, "--objects", "-", "--tree", str(tree), "--quiet"]
    done = subprocess.run(command, input=objects.read_bytes(), capture_output=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"scale 0.")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["--instnces", "x"],
            "estimate-scale: arguments: no option is called --instnces; did you mean '--instances'?\n",
        ),
        (["--zzzz"], "estimate-scale: arguments: no option is called --zzzz; --help lists them\n"),
        (
            ["SCENE", "--detector", "x.onnx", "--images", "/dev/null"],
            "estimate-scale: --images: expected a folder of images; found /dev/null, which is no folder; "
            "try: estimate-scale SCENE --detector x.onnx\n",
        ),
        (["--level"], "estimate-scale: arguments: argument --level: expected one argument (--help lists them)\n"),
    ],
)
def test_wrong_options_are_one_line(words: list[str], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = estimate(capsys, *words)
    assert (status, out, err) == (2, "", line)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_names_every_option(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as leave:
        main(["--completion", shell])
    assert leave.value.code == 0
    out = capsys.readouterr().out
    assert ("-l write-scaled" if shell == "fish" else "--write-scaled") in out
    if shell == "bash":
        check = f"{out}\nCOMP_WORDS=(estimate-scale --write); COMP_CWORD=1; _estimate_scale; echo ${{COMPREPLY[@]}}"
        done = subprocess.run(["bash", "-c", check], capture_output=True, text=True, timeout=300, check=True)
        assert done.stdout == "--write-scaled\n"
    if shell == "fish":
        assert "-d '" in out
