"""The study's page in a real browser: a person answers, the file is saved, the report reads it."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.user_study.answers import read_answers
from benchmarks.user_study.make import main
from benchmarks.user_study.page import STEPS, study_page
from tests.support.browser import Browser


def test_answers_are_saved_and_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The participant judges objects that are 10 % too large as too large, and uses keys and buttons in turn."""
    pictures = {step: np.full((24, 32, 3), 128 + step, np.uint8) for step in STEPS}
    page = tmp_path / "study.html"
    page.write_text(study_page(pictures, "How large is it?", "chair", 1), encoding="utf-8")
    saved = tmp_path / "saved"
    saved.mkdir()
    with Browser(tmp_path / "profile") as browser:
        browser.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(saved))
        browser.open(page.as_uri())
        browser.run("document.querySelector('button').click()")
        for number in range(len(STEPS)):
            browser.wait(f"answers.length === {number} && waiting && document.querySelector('img').complete")
            assert browser.run("document.querySelector('img').naturalWidth") == 32
            step = browser.run("trials[answers.length].step")
            choice = 0 if step < -10 else 2 if step > 5 else 1
            if number % 2:
                browser.run(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{choice + 1}'}}))")
            else:
                browser.run(f"document.querySelectorAll('.choices button')[{choice}].click()")
        browser.wait("document.querySelector('h1').textContent === 'Thank you'")
        until = time.monotonic() + 180
        while not any(file.stat().st_size for file in saved.glob("*.json")):
            assert time.monotonic() < until, "the file never came"
            time.sleep(0.05)
    (file,) = saved.glob("*.json")
    answers = {answer.step: answer.answer for answer in read_answers(file)}
    assert sorted(answers) == sorted(STEPS)
    assert (answers[-30], answers[0], answers[30]) == ("too small", "right", "too large")
    assert json.loads(file.read_text())["object"] == "chair"
    assert main(["report", str(saved)]) == 0
    assert "1 participant(s)" in capsys.readouterr().out
