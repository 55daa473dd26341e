"""Two readers, a third where they differ, kappa, and the command that records."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.items import RawItem
from metric_base.folders import taxonomy_directory
from metric_base.records import json_record
from metric_cli.subcommands import main
from taxonomy.categories import insertions
from taxonomy.levels import replaced_ids
from taxonomy.matching.decisions import (
    WITHDRAWN,
    BadDecision,
    Decision,
    agreement,
    decisions,
    disagreements,
    record_decision,
    rulings,
    waiting,
)


def decision(reviewer: str, concept: str | None, subject: str = "*: chair", blind: bool = True) -> Decision:
    return Decision(what="match", subject=subject, decision=concept, reviewer=reviewer, when="2026-11-21", blind=blind)


def test_one_reader_settles_nothing() -> None:
    found = [decision("a", "chair.n.01")]
    assert rulings(found) == {}
    assert waiting(found) == [("match", "*: chair")]


def test_two_readers_who_agree_settle() -> None:
    found = [decision("a", "chair.n.01"), decision("b", "chair.n.01")]
    assert rulings(found)["*", "chair"].decision == "chair.n.01"
    assert waiting(found) == []


def test_the_same_reader_twice_is_one_reader_and_the_later_word_counts() -> None:
    found = [decision("a", "chair.n.01"), decision("a", None), decision("b", None)]
    assert rulings(found[:2]) == {}
    assert rulings(found)["*", "chair"].decision is None


def test_a_persons_word_outranks_those_of_programs() -> None:
    programs = [decision(f"program: {name} reading", "stool.n.01") for name in ("first", "second")]
    assert rulings(programs)["*", "chair"].decision == "stool.n.01"
    ada, grace, mary = (decision(name, "chair.n.01") for name in ("Ada", "Grace", "Mary"))
    for order in ([*programs, ada], [ada, *programs], [programs[0], ada]):
        assert rulings(order)["*", "chair"].decision == "chair.n.01"
        assert waiting(order) == []
    against = decision("Grace", None)
    assert waiting([*programs, ada, against]) == [("match", "*: chair")]
    assert rulings([*programs, against, ada, mary])["*", "chair"].decision == "chair.n.01"
    assert rulings([*programs, ada, grace])["*", "chair"].decision == "chair.n.01"


def test_every_reading_that_ships_says_that_a_program_read_it() -> None:
    assert all(one.is_programs for one in decisions(taxonomy_directory() / "decisions"))


def test_disagreement_waits_for_a_third() -> None:
    found = [decision("a", "chair.n.01"), decision("b", "stool.n.01")]
    assert waiting(found) == [("match", "*: chair")]
    assert [pair[1].decision for pair in disagreements(found)] == ["stool.n.01"]
    settled = [*found, decision("c", "stool.n.01", blind=False)]
    assert rulings(settled)["*", "chair"].decision == "stool.n.01"
    assert rulings([*found, decision("c", None)]) == {}


def test_kappa_by_hand() -> None:
    pairs = [("x", "x"), ("x", "x"), ("y", "y"), ("x", "y")]
    found = [d for i, (a, b) in enumerate(pairs) for d in (decision("a", a, f"s: {i}"), decision("b", b, f"s: {i}"))]
    result = agreement(found)
    expected = 0.75 * 0.5 + 0.25 * 0.5
    assert result.n == 4
    assert result.share == 0.75
    assert result.kappa == pytest.approx((0.75 - expected) / (1 - expected))


def test_amendments_do_not_count_as_agreement() -> None:
    found = [decision("a", "x"), decision("b", "x", blind=False)]
    assert agreement(found).n == 0
    assert math.isnan(agreement(found).kappa)
    assert rulings(found)["*", "chair"].decision == "x"


@given(st.lists(st.sampled_from(["x", "y", None]), min_size=1, max_size=20))
def test_a_reader_agrees_with_itself(answers: list[str | None]) -> None:
    found = [decision(r, answer, f"s: {i}") for i, answer in enumerate(answers) for r in ("a", "b")]
    assert agreement(found).kappa == 1.0


@given(
    subject=st.text(min_size=1, max_size=20).map(lambda words: f"s: {words}"),
    concept=st.one_of(st.none(), st.just("chair.n.01")),
    why=st.text(max_size=30),
    blind=st.booleans(),
)
def test_a_decision_survives_its_line(subject: str, concept: str | None, why: str, blind: bool) -> None:
    written = Decision(what="match", subject=subject, decision=concept, reviewer="r", when="now", why=why, blind=blind)
    assert json_record(written.line(), Decision) == written


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{", "expected a JSON object"),
        ("[]", "expected a JSON object, found array"),
        ('{"what": "match", "subject": "chair", "decision": "none", "reviewer": "a", "when": ""}', "<source>: <words>"),
        ('{"what": "guess", "subject": "*: a", "decision": "none", "reviewer": "a", "when": ""}', "what: expected"),
        ('{"what": "match", "subject": "*: a", "decision": "none", "reviewer": " ", "when": ""}', "reviewer: expected"),
        ('{"what": "match", "subject": "*: a", "reviewer": "a", "when": ""}', "decision: expected a value, found none"),
    ],
)
def test_a_bad_line_is_named_with_file_and_number(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "d.jsonl").write_text("\n" + line + "\n", encoding="utf-8")
    with pytest.raises(BadDecision, match=r"d\.jsonl:2: ") as error:
        decisions(tmp_path)
    assert message in str(error.value)


def test_recording_adds_a_line_and_leaves_no_part(tmp_path: Path) -> None:
    file = tmp_path / "new" / "d.jsonl"
    record_decision(decision("a", "chair.n.01"), file)
    record_decision(decision("b", None), file)
    assert [d.reviewer for d in decisions(file.parent)] == ["a", "b"]
    assert [path.name for path in file.parent.iterdir()] == ["d.jsonl"]
    with pytest.raises(BadDecision, match="one that a has not decided"):
        record_decision(decision("a", None), file)


@pytest.mark.usefixtures("wordnet")
def test_the_command_records_and_lists(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = ["--folder", str(tmp_path)]
    record = ["review", "record", "*: foo", "chair.n.01", "--reviewer", "Ada", *folder]
    assert main([*record, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recorded"] == "*: foo"
    assert main(["review", "list", *folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["waiting"] == [{"what": "match", "subject": "*: foo"}]
    assert main(["review", "blind", "--reviewer", "Ada", *folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert main(["review", "blind", "--reviewer", "Grace", *folder, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == [{"subject": "*: foo", "words": "foo"}]


@pytest.mark.usefixtures("wordnet")
def test_words_are_listed_from_packed_files_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    item = RawItem(
        source="shop", source_id="1", category_path=("zzyzx",), dimensions_mm={"height": 1.0}, kind="product"
    )
    (tmp_path / "raw.jsonl.gz").write_bytes(gzip.compress(item.line().encode() + b"\n"))
    assert main(["review", "list", str(tmp_path), "--folder", str(tmp_path / "none"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "metric-tree/review/1"
    assert [(row["source"], row["items"]) for row in found["words"]] == [("shop", 1)]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["*: foo", "chair.n.99", "--reviewer", "Ada"], "decision: expected a WordNet 3.0 synset"),
        (["ikea_sa_2002: foo", "chair.n.01", "--reviewer", "Ada"], "expected a source (ikea_sa_2020, "),
        (["foo", "chair.n.01", "--reviewer", "Ada"], "subject: expected <source>: <words>"),
    ],
)
@pytest.mark.usefixtures("wordnet")
def test_a_bad_record_is_one_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main(["review", "record", *words, "--folder", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_shipped_decisions_have_two_readers_each() -> None:
    assert waiting(decisions()) == []
    assert agreement(decisions(), "match").n >= 700


def test_shipped_insertions_stand_where_two_readers_put_them() -> None:
    readings: dict[str, list[str | None]] = {}
    for found in decisions():
        if found.what == "insertion":
            readings.setdefault(found.subject, []).append(found.decision)
    parents = {insertion.id: insertion.parent for insertion in insertions().values()}
    assert {subject for subject, parent in parents.items() if readings[subject].count(parent) < 2} == set()
    assert set(readings) - set(parents) <= set(replaced_ids())


def test_a_withdrawn_word_counts_no_more() -> None:
    given = [decision("a", "x"), decision("b", "x"), decision("b", WITHDRAWN, blind=False)]
    assert rulings(given) == {}
    assert waiting(given) == [("match", "*: chair")]
    assert rulings([*given, decision("b", "x")])["*", "chair"].decision == "x"


def test_a_withdrawn_subject_waits_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its items are unsettled: it is in the list, and so are its words."""
    both = [decision("a", "chair.n.01"), decision("b", "chair.n.01")]
    gone = [decision("a", "withdrawn"), decision("b", "withdrawn")]
    assert waiting(both) == []
    assert waiting([*both, *gone]) == [("match", "*: chair")]
    (tmp_path / "d.jsonl").write_text("".join(one.line() + "\n" for one in [*both, *gone]))
    assert main(["review", "list", "--folder", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["waiting"] == [{"what": "match", "subject": "*: chair"}]


def test_an_amendment_needs_an_earlier_word(tmp_path: Path) -> None:
    file = tmp_path / "d.jsonl"
    with pytest.raises(BadDecision, match="one that a has decided"):
        record_decision(decision("a", "x"), file, amend=True)
    record_decision(decision("a", "x"), tmp_path / "c.jsonl")  # another file of the folder
    record_decision(decision("a", "y", blind=False), file, amend=True)
    record_decision(decision("a", WITHDRAWN, blind=False), file, amend=True)
    with pytest.raises(BadDecision, match="one that a has decided"):
        record_decision(decision("a", WITHDRAWN, blind=False), file, amend=True)
    record_decision(decision("a", "z"), file)
    assert [one.decision for one in decisions(tmp_path)] == ["x", "y", WITHDRAWN, "z"]


@pytest.mark.usefixtures("wordnet")
def test_a_review_is_amended_withdrawn_and_named_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = ["review", "record", "*: foo", "--folder", str(tmp_path), "--json"]
    assert main([*record, "couch.n.01", "--reviewer", "Ada"]) == 0
    assert main([*record, "sofa.n.01", "--reviewer", "Grace"]) == 0
    assert waiting(decisions(tmp_path)) == [], "two words of a synset are the same decision"
    assert main([*record, "chair.n.01", "--reviewer", "Grace"]) == 2
    assert main([*record, "chair.n.01", "--reviewer", "Grace", "--amend"]) == 0
    assert main([*record, "withdrawn", "--reviewer", "Ada"]) == 0
    capsys.readouterr()
    assert main(["review", "list", "--folder", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["waiting"] == [{"what": "match", "subject": "*: foo"}]
    assert (
        main(["review", "record", "mt:nothing_such", "none", "--what", "insertion", "--reviewer", "Ada", *record[3:5]])
        == 2
    )
    assert "subject: expected an insertion" in capsys.readouterr().err


EXAMPLES = Path(__file__).parents[3] / "data" / "examples" / "source"


@pytest.mark.usefixtures("wordnet")
def test_a_word_may_be_about_a_host_or_a_source_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The items of `crawl generic` have their host as source; a folder's declarations are known where it is named."""
    record = ["sofa.n.01", "--reviewer", "Ada", "--folder", str(tmp_path), "--json"]
    assert main(["review", "record", "shop.example: foo", *record]) == 0
    assert main(["review", "record", "lamps: foo", *record]) == 2
    assert main(["review", "record", "lamps: foo", *record, "--sources", str(EXAMPLES)]) == 0
    assert [one.subject for one in decisions(tmp_path)] == ["shop.example: foo", "lamps: foo"]
    assert "subject: expected a source (" in capsys.readouterr().err


@pytest.mark.usefixtures("wordnet")
def test_a_blind_list_shows_an_example_of_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    item = RawItem(
        source="shop",
        source_id="1",
        title="A zzyzx",
        category_path=("zzyzx",),
        dimensions_mm={"height": 10.0},
        extents_mm=(10.0,),
        images=("https://example.org/1.jpg",),
        kind="product",
    )
    raw = tmp_path / "raw.jsonl"
    raw.write_text(item.line() + "\n", encoding="utf-8")
    folder = tmp_path / "decisions"
    for subject in ("shop: zzyzx", "*: bar", "*: baz"):
        record_decision(decision("Ada", None, subject), folder / "d.jsonl")
    blind = ["review", "blind", "--reviewer", "Grace", "--folder", str(folder), "--json"]
    assert main([*blind, "--source", "shop", str(raw)]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row == {
        "subject": "shop: zzyzx",
        "words": "zzyzx",
        "title": "A zzyzx",
        "size": "10",
        "picture": "https://example.org/1.jpg",
        "page": "",
    }
    assert main([*blind, "--limit", "2"]) == 0
    assert len(json.loads(capsys.readouterr().out)) == 2
    assert main([*blind, "--limit", "0"]) == 2
    assert main(["review", "list", str(raw), "--folder", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["words"] == [], "what one reviewer has read does not wait for a first"


def test_a_decision_is_recorded_where_its_reviewer_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In `./decisions`, or where the program is installed in the user's data folder; both are read by default."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr("taxonomy.matching.decisions.data_folder", lambda: tmp_path)
    record = ["review", "record", "*: foo", "chair.n.01", "--why", "a\u2028b", "--json", "--reviewer"]
    assert main([*record, "Ada"]) == 0
    (tmp_path / "decisions").mkdir()
    assert main([*record, "Grace"]) == 0
    files = [tmp_path / "data" / "metric-tree" / "decisions" / "recorded.jsonl", tmp_path / "decisions/recorded.jsonl"]
    assert all(file.read_text(encoding="utf-8").count("\n") == 1 for file in files)
    given = [one.reviewer for one in decisions() if one.subject == "*: foo"]
    assert given == ["Ada", "Grace"]
    assert main(["review", "list", "--json"]) == 0
    capsys.readouterr()
