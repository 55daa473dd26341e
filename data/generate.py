"""The tables in `data` that a command writes.

    python -m data.generate words                       # senses.tsv, heads.tsv, near_words.txt
    python -m data.generate codes --openimages FILE --imagenet FILE
    python -m data.generate reliability
    python -m data.generate repeated ../shared/data/sizes
    python -m data.generate photographs ../shared/data/pictures
    python -m data.generate illustrations ../shared/data/models

The commands `words`, `codes` and `reliability` write to `data/taxonomy/generated`.

`words`: `senses.tsv` has a line for each noun of WordNet with a sense that is an object, and for each
name of an inserted category: the word, then its senses in WordNet's order, each as `count:node>node`, where `count` is
how often WordNet's tagged texts use the word so and the nodes are the concept's own node and those above it, nearest
first. `heads.tsv` says how far a head noun can be trusted: of the known compounds that end in the word (`car door`,
`barn door`), how many are kinds of each node that the word alone names. `near_words.txt` has the English words, with
the forms of verbs, that are one letter off a word of a name without being one: `tunnel` is not a misspelt `funnel`.

`photographs`: `data/raw/pictures-1-0.jsonl` and its files in `data/images` are the photographs of objects whose cut by
`data/curated/guides.jsonl` its reviewer calls good, cropped, with transparency; they hang on the range of their kind.

`illustrations`: `data/raw/pictures-2-0.jsonl` and its files in `data/images` are two views, front and oblique, of the
models in `data/curated/illustrations.csv`. Their sizes are not those of their kind (a sitting cat, an open laptop), so
that they hang on its range, too.

`codes`: `codes.tsv` has the ids of label lists: ImageNet's `n02119789`, Open Images' `/m/01mzpv`.

`reliability`: how often each rule of the matcher is right on the development half of the labelled strings, without the
decisions on the strings themselves (`reliability.json`).

`repeated`: rows of sets of ScanNet's boxes that another set states better (`data/sources/*.superseded.txt`). A box
along the room's axes under a fine name is better than one under a coarse name; a minimal box, which has a footprint of
its own, is better than both. Two rows are one object if they are of one scan and agree in their sizes: the fine names'
are rounded to 10 mm, a minimal box agrees in height alone.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.taxonomy.matching import counts_by_rule, labelled, matcher_without
from insertion.render.gpu import gl_context
from insertion.render.studio import studio_views
from metric_base.files import whole_file
from metric_tree.cutouts.guided import METHOD, guided_foreground, guides
from metric_tree.cutouts.quality import assessment
from models3d.gltf.model_reader import read_model
from models3d.model import Model
from taxonomy.catalogue import OTHER, Catalogue, default_catalogue
from taxonomy.label_lists import vocabulary
from taxonomy.matching.decisions import decisions, rulings
from taxonomy.matching.reliability import reliabilities
from taxonomy.wordnet import WordNet, default_wordnet
from taxonomy.words.spelling import fold_text, one_edit

RAW = Path(__file__).with_name("raw")

#: Tables that the commands `words`, `codes` and `reliability` write.
GENERATED = Path(__file__).parent / "taxonomy" / "generated"

#: Longer side of a photograph that ships, in pixels.
MAX_SIDE_PX = 512

#: Azimuths of the views of an illustration in degrees: front and oblique.
VIEWS_DEG = (0.0, 30.0)
#: Source of the models of Sweet Home 3D.
DEBIAN = "https://snapshot.debian.org/package/sweethome3d-furniture/1.8-1/"

#: Nodes of the photographs' categories.
KINDS = {
    "apple": "apple.n.01", "aubergine": "eggplant.n.01", "avocado": "avocado.n.01", "banana": "banana.n.02",
    "cabbage": "head_cabbage.n.02", "carrots": "carrot.n.03", "cucumber": "cucumber.n.02", "kiwi": "kiwi.n.03",
    "lemon": "lemon.n.01", "lime": "lime.n.06", "mango": "mango.n.02", "melon": "melon.n.01", "milk": "mt:milk_carton",
    "mushroom": "mushroom.n.05", "onion": "onion.n.01", "orange": "orange.n.01", "papaya": "papaya.n.02",
    "peach": "peach.n.03", "pear": "pear.n.01", "pepper": "bell_pepper.n.02", "plum": "plum.n.02",
    "pomegranate": "pomegranate.n.02", "potato": "potato.n.01", "red beet": "beet.n.02",
    "red grapefruit": "grapefruit.n.02", "satsumas": "mandarin.n.05", "soy milk": "mt:milk_carton",
    "tomato": "tomato.n.01", "yoghurt": "carton.n.02", "zucchini": "zucchini.n.02",
}  # fmt: skip

SOURCES = Path(__file__).with_name("sources")

#: Steps up from a concept to a node that still limits its size.
STEPS = 4

#: Nodes above this level limit no size.
MIN_LEVEL = 3

#: Compounds of a head word before a share is stated.
MIN_COMPOUNDS = 3

#: Letters of a word that may be misspelt.
MIN_MISSPELT_LETTERS = 5

#: How WordNet marks the senses that insult people. They are no names of objects, and are not shipped.
INSULTS = re.compile(
    r"ethnic slur|offensive (?:term|name|word)|\(offensive\)|derogatory|disparaging|obscene|thoroughly disliked"
)


class Chains:
    """Nodes of a concept and above it, nearest first."""

    def __init__(self, catalogue: Catalogue, wordnet: WordNet) -> None:
        self._catalogue = catalogue
        self._wordnet = wordnet
        self._levels = {one.node_id: one.level for one in catalogue.categories}
        self._memory: dict[str, tuple[str, ...]] = {}

    def of(self, concept: str) -> tuple[str, ...]:
        """The nodes of a concept: its own, then those of what is above it."""
        if concept not in self._memory:
            self._memory[concept] = self._of(concept)
        return self._memory[concept]

    def _of(self, concept: str) -> tuple[str, ...]:
        at = self._catalogue.successors.get(concept, concept)
        chain = [at] if self._levels.get(at, 0) >= MIN_LEVEL else []
        leaf = self._catalogue.leaves.get(at)
        above = leaf.hypernym if leaf is not None and leaf.hypernym else at
        if above.startswith("mt:"):
            return tuple(dict.fromkeys((*chain, *(self.of(above) if above != at else ()))))
        upward = ([above] if above != at else []) + list(self._near(above))
        chain += [node for node in upward if self._levels.get(node, 0) >= MIN_LEVEL]
        return tuple(dict.fromkeys(chain))

    def _near(self, synset: str) -> Iterator[str]:
        level: tuple[str, ...] = (synset,)
        for _ in range(STEPS):
            level = tuple(dict.fromkeys(above for one in level for above in self._wordnet.parents(one)))
            yield from level


def tagged_count(wordnet: WordNet, synset: str, noun: str) -> int:
    """How often the tagged texts of WordNet use a noun in a sense."""
    word = noun.lower().replace(" ", "_")
    return sum(lemma.count() for lemma in wordnet.synset(synset).lemmas() if lemma.name().lower() == word)


def sense_lines(catalogue: Catalogue, wordnet: WordNet) -> dict[str, list[tuple[int, tuple[str, ...]]]]:
    """Senses of every word with at least one that names an object: how often each is meant, and its nodes."""
    chains = Chains(catalogue, wordnet)
    lines: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for noun in sorted(wordnet.nouns):
        general = [sense for sense in wordnet.senses(noun) if not wordnet.synset(sense).instance_hypernyms()]
        decent = [sense for sense in general if not INSULTS.search(wordnet.synset(sense).definition())]
        senses = [(tagged_count(wordnet, sense, noun), chains.of(sense)) for sense in decent]
        if any(nodes for _, nodes in senses):
            lines.setdefault(fold_text(noun), []).extend(senses)
    for category in catalogue.categories:
        if category.node_id.startswith("mt:") and not category.node_id.endswith(OTHER):
            for name in (category.name.partition(" (")[0], *category.aliases):
                chain = chains.of(category.node_id)
                line = lines.setdefault(fold_text(name), [])
                if chain and not any(nodes[:1] == chain[:1] for _, nodes in line):
                    line.append((0, chain))
    return {word: line for word, line in lines.items() if word and line}


def head_lines(lines: dict[str, list[tuple[int, tuple[str, ...]]]]) -> Iterator[tuple[str, str, int, int]]:
    """(head word, node, compounds that are kinds of the node, compounds) of words that end three compounds or more."""
    compounds: defaultdict[str, list[set[str]]] = defaultdict(list)
    for phrase, senses in lines.items():
        before, _, head = phrase.rpartition(" ")
        if before and head in lines:
            compounds[head].append({node for _, nodes in senses[:1] for node in nodes})
    for head in sorted(compounds):
        kinds = Counter(node for nodes in compounds[head] for node in nodes)
        own = {nodes[0] for _, nodes in lines[head] if nodes}
        if len(compounds[head]) >= MIN_COMPOUNDS:
            yield from ((head, node, kinds[node], len(compounds[head])) for node in sorted(own) if kinds[node])


def near_words(names: Iterable[str], wordnet: WordNet) -> list[str]:
    """English words that are one letter off a word of a name and are not a word of one."""
    spelt = {word for name in names for word in name.split() if len(word) >= MIN_MISSPELT_LETTERS - 1}
    by_hole: defaultdict[str, set[str]] = defaultdict(set)
    for word in spelt:
        for hole in _holes(word):
            by_hole[hole].add(word)
    inflected = {word.removesuffix("e") + "ing" for word in wordnet.words} | {f"{word}s" for word in wordnet.words}
    english = wordnet.words | inflected | {word.removesuffix("e") + "ed" for word in wordnet.words}
    candidates = (word for word in english - spelt if len(word) >= MIN_MISSPELT_LETTERS)
    return sorted(
        word for word in candidates if any(one_edit(word, one) for hole in _holes(word) for one in by_hole[hole])
    )


def _holes(word: str) -> set[str]:
    """A word, and the word without each of its letters: two words that are one edit apart share one of them."""
    return {word, *(word[:at] + word[at + 1 :] for at in range(len(word)))}


def code_lines(files: dict[str, Path]) -> Iterator[tuple[str, str]]:
    """(code, node) of the labels of lists whose own tables are given: rows `id,name,code` in the list's order."""
    for name, file in files.items():
        with file.open(encoding="utf-8", newline="") as rows:
            codes = [row[2] for row in list(csv.reader(rows))[1:]]
        for code, label in zip(codes, vocabulary(name), strict=True):
            if label.node_id:
                yield code, label.node_id


#: Half a step of rounding at both ends, and the height of a minimal box against that of one along the axes.
SIDES_MM, HEIGHT_MM = 11.0, 15.0
AXES = ("length_mm", "width_mm", "height_mm")
#: Names of minimal boxes, and what the other sets call those objects.
NAMES = {"trash bin": {"trash can", "recycling bin"}, "tv": {"television"}, "chair": {"office chair", "armchair"}}

#: What the declarations refuse anyway: cut by the scan, or a mixture.
REFUSED = {"door", "window", "curtain", "shower curtain", "counter", "otherfurniture"}

Box = tuple[str, str, tuple[float, ...]]


def _boxes(path: Path) -> dict[str, list[Box]]:
    """Id, name and sides of each box with a known vertical, by scan."""
    by_scan: dict[str, list[Box]] = defaultdict(list)
    with path.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            if row["height_mm"] and row["category"] not in REFUSED:
                sides = tuple(float(row[axis]) for axis in AXES)
                by_scan[row["instance_or_n"].split("/")[0]].append((row["instance_or_n"], row["category"], sides))
    return by_scan


def _same_sides(one: Box, other: Box) -> bool:
    """Whether two boxes along the same axes are of one object."""
    return all(abs(a - b) <= SIDES_MM for a, b in zip(one[2], other[2], strict=True))


def _same_height(one: Box, other: Box) -> bool:
    """Whether a box along the axes may be the object of a minimal box: by name and height."""
    return one[1] in {other[1], *NAMES.get(other[1], ())} and abs(one[2][2] - other[2][2]) <= HEIGHT_MM


def superseded(sizes: Path) -> dict[str, list[str]]:
    """Ids of the rows of each set that another one states better, sorted."""
    coarse, fine, minimal = (
        _boxes(sizes / name / f"{name}.csv") for name in ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")
    )
    gone: dict[str, set[str]] = {"scannet18_boxes": set(), "scannet_fine_boxes": set()}
    for name, boxes_of, others, same in (
        ("scannet18_boxes", coarse, fine, _same_sides),
        ("scannet18_boxes", coarse, minimal, _same_height),
        ("scannet_fine_boxes", fine, minimal, _same_height),
    ):
        for scan, better in others.items():
            for box in better:
                match = next((b for b in boxes_of.get(scan, []) if b[0] not in gone[name] and same(b, box)), None)
                if match is not None:
                    gone[name].add(match[0])
    return {name: sorted(ids) for name, ids in gone.items()}


def write_words() -> None:
    """Write the tables of words."""
    catalogue, wordnet = default_catalogue(), default_wordnet()
    lines = sense_lines(catalogue, wordnet)
    senses = (f"{word}\t" + ";".join(f"{n}:{'>'.join(nodes)}" for n, nodes in lines[word]) for word in sorted(lines))
    names = (fold_text(name) for one in catalogue.categories for name in (one.name, *one.aliases))
    _write(GENERATED / "senses.tsv", senses)
    _write(GENERATED / "heads.tsv", ("\t".join(map(str, row)) for row in head_lines(lines)))
    _write(GENERATED / "near_words.txt", near_words(names, wordnet))


def write_reliability() -> None:
    """Write the share of right findings of each rule; rules on titles keep their counts."""
    development = [one for one in labelled() if one.half == "development"]
    file = GENERATED / "reliability.json"
    record = json.loads(file.read_text(encoding="utf-8"))
    titles = {rule: tuple(counts) for rule, counts in record["counts"].items() if rule.startswith("title ")}
    own = counts_by_rule(development, matcher_without(development, rulings(decisions()), {}))
    record["counts"] = dict(sorted((own | titles).items()))
    record["reliability"] = reliabilities(record["counts"])
    _write(file, [json.dumps(record, indent=1)])


def write_photographs(folder: Path) -> None:
    """The photographs of a folder with `pictures.csv` that have a good guide."""
    drawn = guides(RAW.parent / "curated" / "guides.jsonl")
    records = []
    with (folder / "pictures.csv").open(encoding="utf-8", newline="") as lines:
        rows = {row["sha256"]: row for row in csv.DictReader(lines) if row["sha256"] in drawn}
    for sha256, row in sorted(rows.items()):
        if drawn[sha256].verdict != "good":
            continue
        data = np.asarray(Image.open(folder / row["file"]).convert("RGB"))
        alpha = guided_foreground(data, drawn[sha256]).alpha
        told = assessment(data, alpha)
        x, y, width, height = told.box
        image = Image.fromarray(np.dstack([data, alpha])[y : y + height, x : x + width])
        image.thumbnail((MAX_SIDE_PX, MAX_SIDE_PX))
        image.save(sink := BytesIO(), "WEBP", quality=90, method=6)
        image_id = _stored(sink.getvalue())
        records.append(
            {
                "schema": "metric-tree/picture/1", "image_id": image_id, "item_id": f"judged:{KINDS[row['category']]}",
                "path": f"{image_id[:2]}/{image_id}.webp", "width_px": image.width, "height_px": image.height,
                "foreground_share": round(float(np.asarray(image)[..., 3].mean()) / 255, 6), "method": METHOD,
                "source_url": f"https://github.com/{row['source'].partition(' ')[0]}",
                "licence": row["licence"], "attribution": row["attribution"],
            }
        )  # fmt: skip
    records.sort(key=lambda record: (record["item_id"], record["image_id"]))
    _write(RAW / "pictures-1-0.jsonl", map(json.dumps, records))


def _stored(body: bytes) -> str:
    """Write an image to the store, and return its id."""
    image_id = hashlib.sha256(body).hexdigest()
    (file := RAW.parent / "images" / image_id[:2] / f"{image_id}.webp").parent.mkdir(exist_ok=True)
    file.write_bytes(body)
    return image_id


def _part_in_box(model: Model, box_m: list[float]) -> Model:
    """Return the triangles of a set of objects that are in a box of its file, minimum and maximum of x, y and z."""
    low, high = np.reshape(box_m, (3, 2)).T
    parts = []
    for mesh in model.meshes:
        corners = mesh.vertices[mesh.faces]  # (m, 3, 3)
        is_inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
        parts.append(replace(mesh, faces=mesh.faces[is_inside]))
    return replace(model, meshes=tuple(part for part in parts if len(part.faces)))


def write_illustrations(folder: Path) -> None:
    """Views of the models that `illustrations.csv` names, from a folder with `models.csv`."""
    with (folder / "models.csv").open(encoding="utf-8", newline="") as lines:
        models = {row["file"]: row for row in csv.DictReader(lines)}
    os.environ.setdefault("LP_NUM_THREADS", "1")
    context = gl_context()
    records = []
    with (RAW.parent / "curated" / "illustrations.csv").open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            node_id, file = row["node_id"], row["model"]
            place, commit = models[file]["source"].split(" @ ") if " @ " in models[file]["source"] else (None, None)
            url = DEBIAN if place is None else f"https://github.com/{place.replace(' : ', f'/tree/{commit}/')}"
            model = read_model(folder / file)
            if row["box_m"]:
                model = _part_in_box(model, [float(side) for side in row["box_m"].split()])
            for view in studio_views(context, model, MAX_SIDE_PX, VIEWS_DEG):
                Image.fromarray(view.rgba, "RGBA").save(sink := BytesIO(), "WEBP", quality=80, method=6)
                image_id = _stored(sink.getvalue())
                records.append(
                    {
                        "schema": "metric-tree/picture/1", "image_id": image_id, "item_id": f"judged:{node_id}",
                        "path": f"{image_id[:2]}/{image_id}.webp", "width_px": view.rgba.shape[1],
                        "height_px": view.rgba.shape[0], "foreground_share": round(view.foreground_share, 6),
                        "method": "rendered", "source_url": url,
                        "licence": models[file]["licence"], "attribution": models[file]["attribution"],
                        "pixels_per_metre": round(view.pixels_per_metre, 3),
                    }
                )  # fmt: skip
    records.sort(key=lambda record: (record["item_id"], record["image_id"]))
    _write(RAW / "pictures-2-0.jsonl", map(json.dumps, records))


def _write(file: Path, lines: Iterable[str]) -> None:
    with whole_file(file) as part:
        part.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    print(file)


def main() -> None:
    """Write the tables of one kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    kinds.add_parser("words")
    kinds.add_parser("reliability")
    codes = kinds.add_parser("codes")
    codes.add_argument("--openimages", type=Path, required=True, help="Open Images' classes as id,name,mid")
    codes.add_argument("--imagenet", type=Path, required=True, help="ImageNet's classes as id,name,synset offset")
    kinds.add_parser("photographs").add_argument("pictures", type=Path, help="folder with pictures.csv")
    kinds.add_parser("illustrations").add_argument("models", type=Path, help="folder with models.csv")
    kinds.add_parser("repeated").add_argument("sizes", type=Path, help="folder of the tables of boxes")
    arguments = parser.parse_args()
    if arguments.kind == "words":
        write_words()
    elif arguments.kind == "reliability":
        write_reliability()
    elif arguments.kind == "photographs":
        write_photographs(arguments.pictures)
    elif arguments.kind == "illustrations":
        write_illustrations(arguments.models)
    elif arguments.kind == "codes":
        lists = {"imagenet_1k": arguments.imagenet, "openimages_601": arguments.openimages}
        _write(GENERATED / "codes.tsv", ("\t".join(row) for row in sorted(set(code_lines(lists)))))
    else:
        for name, ids in superseded(arguments.sizes).items():
            _write(SOURCES / f"{name}.superseded.txt", ids)


if __name__ == "__main__":
    main()
