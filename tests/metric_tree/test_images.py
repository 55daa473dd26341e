"""Images of a crawl into a build: joined to their items, linked once, licences kept, hostile records told."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

import metric_cli.subcommands.data.build as command
import metric_tree
from crawler.fetch.item_images import picture
from explorer.static_site import write_site
from metric_cli.subcommands import main
from metric_tree.checks.release_files import findings
from metric_tree.pipeline.build import PRIVATE_LICENCE, build_release
from metric_tree.pipeline.ingest import raw_files
from metric_tree.release.images import image_files, image_path, image_record_files, stored_file
from metric_tree.release.publication import publish
from metric_tree.release.registry import registry_entry
from metric_tree.release.release import BadRelease, sha256
from tests.synthetic.picture_fixture import release_with, shop_picture
from tests.synthetic.raw_fixture import SOURCES, synthetic_items, written
from tests.synthetic.small_taxonomy import small_taxonomy


@pytest.fixture
def crawl(tmp_path, monkeypatch):
    """A folder as a crawl leaves it: items, images of eight of them, the files."""
    monkeypatch.setattr(command, "build_release", partial(build_release, taxonomy=small_taxonomy))
    monkeypatch.setattr(command, "declared_sources", lambda _: SOURCES)
    monkeypatch.setattr(command, "shipped_curated", tuple)
    folder = tmp_path / "crawl"
    folder.mkdir()
    items = synthetic_items(per_class=12)
    written(folder / "items-000000001-000000099.jsonl", items)
    chairs = [item for item in items if "chair" in item.category_path][:8]
    found = [
        picture(shop_picture(k // 2), item.url, item.identity, folder / "pictures") for k, item in enumerate(chairs)
    ]
    lines = [one.line() for one in found] + [found[0].line().replace(found[0].item_id, "lab:gone")]
    (folder / "pictures-000000001-000000099.jsonl").write_text("\n".join(lines) + "\n")
    return folder


def run(crawl, out, *words):
    return main(["build", *map(str, (crawl, "--out", out, "--workers", 1, "--no-heldout", *words))])


def records(crawl):
    return crawl / "pictures-000000001-000000099.jsonl"


def test_picture_records_are_no_raw_items(crawl):
    assert [path.name for path in raw_files([crawl])] == ["items-000000001-000000099.jsonl"]
    assert image_record_files([crawl]) == [records(crawl)]
    assert image_record_files([crawl / "items-000000001-000000099.jsonl"]) == [records(crawl)]
    beside = crawl.parent / "raw.jsonl"
    assert image_record_files([beside]) == [], "a file applies to its folder, not to folders below it"


def test_a_build_takes_the_pictures_of_what_it_ships(crawl, tmp_path):
    assert run(crawl, tmp_path / "release") == 0
    tree = metric_tree.open(tmp_path / "release")
    rows = tree.find("entity").images().to_pylist()
    shipped = {row["item_id"] for row in tree.find("entity").items().to_pylist()}
    assert rows
    assert {row["item_id"] for row in rows} <= shipped
    assert {row["licence"] for row in rows} == {"CC0-1.0"}
    assert all(image_path(tmp_path / "release", row).is_file() for row in rows)
    assert tree.find("chair").images().num_rows == tree.find("seat").images().num_rows == len(rows)
    assert tree.find("table").images().num_rows == 0
    assert not [finding for finding in findings(tmp_path / "release") if finding.is_error]
    report = json.loads((tmp_path / "release.build" / "report.json").read_text())
    assert report["pictures"]["taken"] == len(rows)
    assert report["pictures"]["left_out"]["no_item"] == 9 - len(rows)


def test_private_sources_are_kept_on_request_and_say_so(crawl, tmp_path):
    assert run(crawl, tmp_path / "release") == 0
    assert run(crawl, tmp_path / "private", "--include-withheld", "shop") == 0
    public, private = (metric_tree.open(tmp_path / name).find("entity").images() for name in ("release", "private"))
    assert private.num_rows > public.num_rows
    assert set(private["licence"].to_pylist()) == {"CC0-1.0", PRIVATE_LICENCE}
    assert metric_tree.open(tmp_path / "private").release.manifest["private"] == ["shop"]


def test_a_picture_of_two_items_is_one_file(crawl, tmp_path):
    assert run(crawl, tmp_path / "release", "--include-withheld", "shop", "--include-withheld", "club") == 0
    rows = metric_tree.open(tmp_path / "release").find("entity").images().to_pylist()
    files = [path for path in (tmp_path / "release" / "pictures").rglob("*") if path.is_file()]
    assert len(files) == len({row["image_id"] for row in rows}) < len(rows)
    assert all(path.stat().st_nlink > 1 for path in files)


def test_changed_and_missing_files_are_left_out(crawl, tmp_path):
    files = sorted(path for path in (crawl / "pictures").rglob("*.jpg"))
    files[0].write_bytes(b"another")
    files[1].unlink()
    assert run(crawl, tmp_path / "release", "--include-withheld", "shop", "--include-withheld", "club") == 0
    left_out = json.loads((tmp_path / "release.build" / "report.json").read_text())["pictures"]["left_out"]
    assert left_out["changed"] >= 1
    assert left_out["no_file"] >= 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"path": "', '"path": "../../', "path: expected aa/<image_id>.jpg"),
        ("metric-tree/picture/1", "metric-tree/picture/2", "schema: expected metric-tree/picture/1"),
        ('"width_px": 240', '"width_px": -1', "width_px: expected pixels, found -1"),
        ('"source_url": "', '"source_url": 7, "x": "', "source_url: expected a string, found 7"),
        ("{", "", "expected a JSON object"),
    ],
)
def test_a_crooked_record_is_one_line(crawl, tmp_path, capsys, old, new, message):
    text = records(crawl).read_text()
    assert old in text
    records(crawl).write_text(text.replace(old, new, 1))
    assert run(crawl, tmp_path / "release") == 2
    said = capsys.readouterr().err
    assert f"{records(crawl)}:1: " in said
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "release").exists()


def test_an_image_in_the_release_takes_precedence_over_the_shared_store(tmp_path):
    own = tmp_path / "release" / "1.0.0" / "pictures" / "aa" / f"{'a' * 64}.webp"
    stored, name = tmp_path / "images" / "aa" / own.name, f"pictures/aa/{own.name}"
    release, crawl = tmp_path / "release" / "1.0.0", tmp_path / "raw"
    for folder in (own.parent, stored.parent, crawl):
        folder.mkdir(parents=True)
    assert stored_file(release, name) is None
    stored.write_bytes(b"stored")
    assert stored_file(release, name) == stored_file(crawl, name) == stored
    own.write_bytes(b"own")
    assert stored_file(release, name) == own
    assert stored_file(crawl, name) == stored


@pytest.mark.parametrize(
    "name",
    ["pictures/aa/../../secret.webp", "pictures/secret.webp", "../images/secret.webp", "/etc/hostname", "pictures"],
)
def test_names_that_are_no_images_are_not_looked_up_in_the_store(tmp_path, name):
    release = tmp_path / "release" / "1.0.0"
    (tmp_path / "images").mkdir()
    (release / "pictures" / "aa").mkdir(parents=True)
    for folder in (tmp_path / "images", tmp_path):
        (folder / "secret.webp").write_bytes(b"secret")
    assert stored_file(release, name) is None


def test_a_link_out_of_the_store_is_not_followed(tmp_path):
    (tmp_path / "secret.webp").write_bytes(b"secret")
    link = tmp_path / "data" / "images" / "aa" / f"{'a' * 64}.webp"
    link.parent.mkdir(parents=True)
    link.symlink_to(tmp_path / "secret.webp")
    (tmp_path / "data" / "raw").mkdir()
    assert stored_file(tmp_path / "data" / "raw", f"pictures/aa/{link.name}") is None


@pytest.fixture
def shared(tmp_path):
    """A release in `data/release` whose two images are in `data/images`."""
    release = release_with(tmp_path / "data" / "release" / "1.0.0", [shop_picture(0), shop_picture(1)])
    (release.directory / "pictures").rename(tmp_path / "data" / "images")
    return release


def test_a_release_whose_images_are_in_the_store_is_valid_until_one_is_missing(shared, tmp_path):
    assert not [finding for finding in findings(shared.directory) if finding.is_error]
    image = sorted((tmp_path / "data" / "images").rglob("*.jpg"))[0]
    image.unlink()
    errors = {finding.code: finding for finding in findings(shared.directory) if finding.is_error}
    assert set(errors) == {"E106", "E502"}
    assert errors["E106"].subject == f"pictures/{image.parent.name}/{image.name}"
    assert errors["E502"].message.endswith(f"pictures/{image.parent.name}/{image.name}")


def test_changed_bytes_in_the_store_are_found(shared, tmp_path):
    sorted((tmp_path / "data" / "images").rglob("*.jpg"))[0].write_bytes(b"changed")
    assert {finding.code for finding in findings(shared.directory) if finding.is_error} == {"E106", "E504"}


def test_publications_sites_and_registries_contain_the_images_of_the_store(shared, tmp_path):
    tree = metric_tree.open(shared.directory)
    images = set(image_files(shared))
    assert len(images) == 2
    publish(tree, tmp_path / "publication")
    write_site(tmp_path / "site", [tree], 1)
    assert images <= set(registry_entry(shared.directory))
    for name in images:
        for folder in ("publication", "site"):
            assert sha256(tmp_path / folder / name) == Path(name).stem


def test_a_missing_image_stops_a_publication(shared, tmp_path):
    image = sorted((tmp_path / "data" / "images").rglob("*.jpg"))[0]
    image.unlink()
    with pytest.raises(BadRelease, match=rf"{image.name}: expected the file of an image; found none"):
        publish(metric_tree.open(shared.directory), tmp_path / "publication")
    assert not (tmp_path / "publication").exists()
