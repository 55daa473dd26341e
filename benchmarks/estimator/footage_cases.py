"""Cases of the benchmark of real footage: sets, their parts, rendered captures and constructed errors.

A set is one case; its parts are several, and harder ones. They are chosen by a rule from the sets with a reference:
- sets of fewer than 90 images: the first half, the second half;
- sets of up to 100 images: every second image; and, if the images are larger, all of them at 640 px without EXIF;
- longer walks: six windows of thirty images, evenly spaced;
- sets that are frames of a walk, and a film: re-encoded as H.264 of low quality.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import ROOT
from metric_base.arrays import FloatArray

__all__ = [
    "GROUPS",
    "FootageCase",
    "Reference",
    "made_cases",
    "make_input",
    "part_cases",
    "read_reference",
    "set_cases",
]

#: Groups of cases: what they are called in the table.
GROUPS = {
    "set": "Sets",
    "part": "Parts of sets",
    "choosing": "Rendered, for choosing",
    "reported": "Rendered, reported once",
    "error": "Constructed errors",
}
#: Number of images from which a set is cut into windows instead of halves, and up to which its images are thinned out.
MIN_WALK, MAX_THINNED = 90, 100
#: Images of a window, and windows of a walk.
WINDOW, N_WINDOWS = 30, 6
#: Longer side in pixels of reduced images.
REDUCED_SIDE = 640
#: Frames per second and constant rate factor of re-encoded walks: 10 frames a second is slow for a walk, and 30 is a
#: low quality that messengers use.
FILM_RATE, FILM_QUALITY = 10.0, 30
#: Sets whose images are frames of a walk or of an orbit, in order.
WALKS = frozenset(
    {
        *("courthouse_walk", "hexgp_building", "red_kitchen", "seattle_backyard"),
        *("seoul_bull", "snow_walk", "tum_office", "walk_carpark"),
    }
)


@dataclass(frozen=True, slots=True)
class FootageCase:
    """A capture to reconstruct."""

    name: str
    group: str  #: Key of `GROUPS`.
    place: Path  #: Folder of the set, with its reference model; of a rendered capture the name.
    source: str = "images"  #: Video or folder of images in `place`.
    names: tuple[str, ...] = ()  #: Images of a part; empty for all.
    change: str = ""  #: "reduced" or "film", if the images are changed.
    first: int | None = None  #: Number of the reference's image of frame 0 of a video; None for images.
    focal: float | None = None  #: Focal length of the video's own lens, if the reference's images are undistorted.
    chosen_on: bool = False  #: Whether options and gates of the capture were chosen with it.
    unusable: bool = False  #: Whether every model of it is wrong.
    camera_model: str | None = None  #: Camera model that the user forces.
    error: str = ""  #: Kind of the constructed error.


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of a capture."""

    centres: dict[str, FloatArray]  #: Camera centre (3,) by the stem of the frame's name.
    focal: float | None  #: Focal length relative to the longer side.


def set_cases(data: Path) -> list[FootageCase]:
    """Return the sets of `captures` and `scenes` below DATA, their films and `demo_video`, cheapest first."""
    captures, scenes = data / "captures", data / "scenes"
    rows: list[tuple[Path, str, dict[str, object]]] = [
        (captures / "box_desk", "images", {"chosen_on": True}),
        (captures / "seoul_bull", "images", {}),
        (scenes / "tum_office", "images", {}),
        (captures / "seattle_backyard", "images", {}),
        (captures / "banana_lowtex", "images", {"chosen_on": True}),
        (ROOT / "data" / "scenes" / "demo_video", "video.mp4", {"chosen_on": True}),
        (scenes / "walk_carpark", "video.mp4", {"chosen_on": True, "first": 1, "focal": 374.94 / 848}),
        (scenes / "gopro_karma_coast", "video.mp4", {}),
        (captures / "courthouse_walk", "images", {"chosen_on": True}),
        (scenes / "red_kitchen", "images", {}),
        (scenes / "lund_street", "images", {"chosen_on": True}),
        (captures / "dino_toys", "images", {"chosen_on": True}),
        (captures / "snow_walk", "images", {}),
        (captures / "hexgp_building", "images", {"chosen_on": True}),
        (scenes / "carnd_highway", "video.mp4", {}),
        (captures / "skull_flash", "images", {"unusable": True}),
        (scenes / "carnd_highway", "video2_solidWhiteRight.mp4", {}),
        (scenes / "walk_carpark", "images", {}),
    ]
    cases = []
    for place, source, options in rows:
        stem = Path(source).stem
        name = place.name + ("" if stem in ("images", place.name.removeprefix("demo_")) else f"_{stem}")
        cases.append(FootageCase(name, "set", place, source, **options))  # type: ignore[arg-type]  # fields by name
    return cases


def part_cases(sets: list[FootageCase]) -> Iterator[FootageCase]:
    """Yield the parts of the sets that have a reference model, by the rule of the module."""
    for case in sets:
        place = case.place
        if not (place / "sparse").is_dir():
            continue
        if not (place / case.source).is_dir():
            yield FootageCase(
                f"{case.name}, re-encoded", "part", place, case.source, (), "film", case.first, case.focal
            )
            continue
        names = tuple(sorted(path.name for path in (place / case.source).iterdir()))
        cuts: list[tuple[str, tuple[str, ...], str]] = []
        if len(names) < MIN_WALK:
            half = (len(names) + 1) // 2
            cuts += [("first half", names[:half], ""), ("second half", names[half:], "")]
        else:
            starts = [window * (len(names) - WINDOW) // (N_WINDOWS - 1) for window in range(N_WINDOWS)]
            cuts += [(f"{WINDOW} from {start}", names[start : start + WINDOW], "") for start in starts]
        if len(names) <= MAX_THINNED:
            cuts.append(("every second", names[::2], ""))
            if max(_read_image(place / case.source / names[0]).shape) > REDUCED_SIDE:
                cuts.append((f"{REDUCED_SIDE} px", names, "reduced"))
        if place.name in WALKS:
            cuts.append(("re-encoded", names, "film"))
        for part, chosen, change in cuts:
            yield FootageCase(f"{case.name}, {part}", "part", place, case.source, chosen, change)


def made_cases() -> list[FootageCase]:
    """Return the rendered captures and the constructed errors of `tests.synthetic.captures`."""
    from tests.synthetic.captures import CAPTURES, CHOOSING, ERRORS

    cases = [FootageCase(name, "choosing" if name in CHOOSING else "reported", Path(name)) for name in CAPTURES]
    for name, row in ERRORS.items():
        options = {"unusable": row.unusable, "camera_model": row.camera_model, "error": row.error}
        cases.append(FootageCase(name, "error", Path(name), **options))  # type: ignore[arg-type]  # fields by name
    return cases


def make_input(case: FootageCase, folder: Path) -> Path:
    """Return the video or folder of images of a case, which is made in `folder` if it is not there as it is.

    Parts are links; reduced images are JPEG files of OpenCV's default quality, which have no EXIF.
    """
    if case.group not in ("set", "part"):
        if not (folder / "truth.json").is_file():
            from tests.synthetic.captures import CAPTURES, ERRORS, write_capture

            shutil.rmtree(folder, ignore_errors=True)
            write_capture((CAPTURES | ERRORS)[case.name], folder)
        return folder / "images"
    if case.group == "set":
        return case.place / case.source
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    source = case.place / case.source
    if case.change == "film":
        return _film(case, source, folder / "film.mp4")
    for name in case.names:
        if case.change == "reduced":
            image = _read_image(source / name)
            factor = min(1.0, REDUCED_SIDE / max(image.shape))
            reduced = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(folder / "images" / f"{Path(name).stem}.jpg"), reduced)
        else:
            (folder / "images" / name).symlink_to((source / name).resolve())
    return folder / "images"


def _film(case: FootageCase, source: Path, film: Path) -> Path:
    """Write the frames of a video, or the images of a case, as a film of low quality with an even size."""
    from capture.sources.video import Video
    from tests.synthetic.videos import times_of, write_video

    if source.is_file():
        images = [frame.colour for frame in Video(source).frames()]
        rate = Video(source).rate
    else:
        images = [_read_image(source / name)[:, :, ::-1] for name in case.names]
        rate = FILM_RATE
    height, width = (side // 2 * 2 for side in images[0].shape[:2])
    write_video(film, [image[:height, :width] for image in images], times_of(len(images), rate), quality=FILM_QUALITY)
    return film


def _read_image(file: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(file))
    assert image is not None, file
    return np.asarray(image, dtype=np.uint8)


def read_reference(case: FootageCase, inputs: Path) -> Reference | None:
    """Return the reference of a case, None if it has none.

    It is the truth of a rendered scene, or the model in `sparse/0` of the set; frames of a film have the number of the
    image as their name.
    """
    truth = (case.place if case.group == "set" else inputs / case.name) / "truth.json"
    if case.group not in ("set", "part"):
        record = json.loads(truth.read_text(encoding="utf-8"))
        centres = {Path(name).stem: np.array(centre) for name, centre in record["centres"].items()}
        return Reference(centres, record["focal"])
    if not (case.place / "sparse").is_dir():
        record = json.loads(truth.read_text(encoding="utf-8")) if truth.is_file() else {}
        if "frames" not in record:
            return None
        poses = ((row["index"], np.array(row["rotation"]), np.array(row["translation"])) for row in record["frames"])
        camera = record["camera"]
        focal = camera["params"][0] / max(camera["width"], camera["height"])
        return Reference({f"{index:06d}": -rotation.T @ shift for index, rotation, shift in poses}, focal)
    from estimator.reconstructions.pycolmap_library import pycolmap

    model = pycolmap.Reconstruction(case.place / "sparse" / "0")  # of some sets the cameras alone are given
    known = {Path(image.name).stem: image.projection_center() for image in model.images.values() if image.has_pose}
    if case.first is not None:
        known = {f"{int(stem) - case.first:06d}": centre for stem, centre in known.items()}
    elif case.change == "film":
        order = enumerate(Path(name).stem for name in case.names)
        known = {f"{index:06d}": known[stem] for index, stem in order if stem in known}
    elif case.names:
        known = {Path(name).stem: known[Path(name).stem] for name in case.names if Path(name).stem in known}
    camera = next(iter(model.cameras.values()))
    focal = case.focal or float(camera.params[0]) / max(camera.width, camera.height)
    return Reference(known, focal)
