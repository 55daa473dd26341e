"""A WordNet of two dozen nouns in the format of WordNet 3.0 (wndb(5WN)), so that tests need no download."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

LICENCE = "  1 Made for the tests in the form of WordNet 3.0 Copyright 2006\n"

#: id: words, number of the lexicographer file, hypernyms, gloss. The senses of a word are in this order.
SYNSETS: dict[str, tuple[list[str], int, list[str], str]] = {
    "entity": (["entity"], 3, [], "that which is perceived"),
    "artifact": (["artifact"], 3, ["entity"], "a man-made object"),
    "instrumentality": (["instrumentality"], 6, ["artifact"], "an artifact instrumental in some end"),
    "communication": (["communication"], 10, ["entity"], "something communicated"),
    "broadcast": (["television", "tv"], 10, ["communication"], "broadcasting visual images"),
    "set": (["television_receiver", "television_set", "tv"], 6, ["instrumentality"], "a device that receives"),
    "furnishing": (["furnishing"], 6, ["instrumentality"], "goods that make a room fit"),
    "furniture": (["furniture"], 6, ["furnishing"], "furnishings that make a room ready"),
    "seat": (["seat"], 6, ["furniture"], "furniture for sitting on"),
    "chair": (["chair"], 6, ["seat"], "a seat for one person"),
    "president": (["president", "chair"], 18, ["entity"], "the officer who presides"),
    "swivel_chair": (["swivel_chair"], 6, ["chair"], "a chair that swivels on its base"),
    "stool": (["stool"], 6, ["seat"], "a simple seat without a back or arms"),
    "sofa": (["sofa", "couch"], 6, ["seat"], "an upholstered seat for more than one"),
    "drop_leaf": (["drop-leaf_table"], 6, ["furniture"], "a table with a drop-leaf"),
    "chest_of_drawers": (["chest_of_drawers"], 6, ["furniture"], "furniture with drawers"),
    "mouse": (["mouse"], 5, ["animal"], "a small rodent"),
    "device": (["device"], 6, ["instrumentality"], "an instrumentality"),
    "electronic": (["electronic_device"], 6, ["device"], "a device that works electronically"),
    "computer_mouse": (["mouse", "computer_mouse"], 6, ["electronic"], "a device that moves a cursor"),
    "animal": (["animal"], 5, ["entity"], "a living organism"),
    "plate": (["home_plate", "plate"], 6, ["instrumentality"], "a base of baseball"),
    "container": (["container"], 6, ["instrumentality"], "an object that holds other objects"),
    "vase": (["vase"], 6, ["container"], "an open jar"),
    "bowl": (["bowl"], 6, ["container"], "a round vessel"),
    "bowls": (["bowls"], 4, ["entity"], "a game"),
    "leaf": (["leaf"], 20, ["entity"], "an organ of a plant"),
}


def write_wordnet(folder: Path, licence: str = LICENCE) -> Path:
    """Write the files and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    offsets = _offsets(licence)
    (folder / "data.noun").write_text(licence + "".join(_line(key, offsets) for key in SYNSETS), encoding="ascii")
    (folder / "index.noun").write_text(licence + _index(offsets), encoding="ascii")
    (folder / "noun.exc").write_text("leaves leaf\nmice mouse\n", encoding="ascii")
    (folder / "cntlist.rev").write_text("", encoding="ascii")
    for part in ("adj", "adv", "verb"):
        (folder / f"data.{part}").write_text(licence, encoding="ascii")
        (folder / f"index.{part}").write_text(licence, encoding="ascii")
        (folder / f"{part}.exc").write_text("", encoding="ascii")
    return folder


def _offsets(licence: str) -> dict[str, int]:
    offsets, at = {}, len(licence)
    blank = dict.fromkeys(SYNSETS, 0)
    for key in SYNSETS:
        offsets[key] = at
        at += len(_line(key, blank))
    return offsets


def _line(key: str, offsets: dict[str, int]) -> str:
    words, file, above, gloss = SYNSETS[key]
    below = [other for other, (_, _, parents, _) in SYNSETS.items() if key in parents]
    pointers = [f"@ {offsets[k]:08d} n 0000" for k in above] + [f"~ {offsets[k]:08d} n 0000" for k in below]
    named = " ".join(f"{word} 0" for word in words)
    related = "".join(f" {pointer}" for pointer in pointers)
    return f"{offsets[key]:08d} {file:02d} n {len(words):02x} {named} {len(pointers):03d}{related} | {gloss}  \n"


def _index(offsets: dict[str, int]) -> str:
    senses: defaultdict[str, list[int]] = defaultdict(list)
    for key, (words, *_) in SYNSETS.items():
        for word in words:
            senses[word].append(offsets[key])
    lines = []
    for word in sorted(senses):
        found = " ".join(f"{offset:08d}" for offset in senses[word])
        lines.append(f"{word} n {len(senses[word])} 2 @ ~ {len(senses[word])} 0 {found}  \n")
    return "".join(lines)
