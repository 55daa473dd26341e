"""Records of an insertion request, and the parsers of the option values that belong to them.

A request contains final values only: every option is parsed and every default file is found before it is constructed.
The command and `insertion.insert_objects` construct it; the stages of an insertion only read it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from insertion.scene.scale import MetricScale
from metric_base.errors import InputError
from metric_base.parsing import stated_numbers

if TYPE_CHECKING:
    from estimator.records.objects import Up
    from metric_tree.tree import Tree

Renderer = Literal["embedded", "blender"]


@dataclass(frozen=True, slots=True)
class PixelPosition:
    """Position in one frame, in COLMAP pixels: the centre of the first pixel is (0.5, 0.5)."""

    frame: str  #: file name of the frame, with or without suffix, or its index
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class ObjectRequest:
    """One object to insert: its model, size, position and motion.

    The position is given by one of `at`, `on` and `plane`. Without them the object stands in free space.
    """

    model: Path  #: glTF or GLB file
    size: str = "file"  #: `file`, `prior`, or `height=METRES` (also `length=`, `width=`)
    at: PixelPosition | None = None  #: pixel that shows the position
    on: str | None = None  #: category of the object to stand on
    plane: int | None = None  #: index of a support plane, lowest first
    xy_m: tuple[float, float] = (0.0, 0.0)  #: metres along the axes of the plane, from its centre
    facing: float | str = "camera"  #: `camera`, `wall`, or degrees from the direction to the camera
    category: str | None = None  #: category of the object in the tree, for the size `prior`
    clip: str | None = None  #: name or index of the animation; None for the first one, "none" for none
    at_time_s: float | None = None  #: time in the animation at which the object is frozen
    path: tuple[tuple[float, float], ...] = ()  #: corners of a path, pixels of the frame of `at`, or metres as `xy_m`
    speed_m_s: float | None = None  #: speed on the path; None if the path takes the rest of the video
    path_start_s: float = 0.0  #: time of the start on the path, in seconds from the first frame


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSource:
    """Files of a scene, and its scale."""

    folder: Path  #: COLMAP model folder, or work folder of `capture_video`
    scale: MetricScale
    images: Path | None = None  #: folder of the images; None for the folder next to or above the model
    instances: Path | None = None  #: masks of possible occluders; None for those that estimate-scale would use
    moving: Path | None = None  #: masks of moving people and objects in every frame
    dense: str | None = None  #: PLY file of the dense cloud, "none", or None for the file next to the model
    up: Up | None = None  #: the vertical, if it is known


@dataclass(frozen=True, slots=True, kw_only=True)
class InsertionRequest:
    """One run of an insertion.

    Raises
    ------
    InputError
        The request has no objects, or an interval is requested of a scale without one.
    """

    scene: SceneSource
    objects: tuple[ObjectRequest, ...]
    tree: Tree | None = None  #: release for sizes by the prior and for categories; None if no object needs it
    out: Path | None = None  #: video, or new folder of PNG files; None if only a preview or the page is requested
    codec: str | None = None  #: key of `insertion.footage.video_writer.CODECS`; None for the default of the source
    frames: tuple[int, int] | None = None  #: first and last index of the frames to write, inclusive
    renderer: Renderer = "embedded"
    show_interval: bool = False  #: draw outlines at both ends of the scale interval
    layers: Path | None = None  #: new folder for OpenEXR layers
    export: Path | None = None  #: new folder for the scene in metres

    def __post_init__(self) -> None:
        if not self.objects:
            raise InputError("--model: expected at least one object; found none")
        if self.show_interval and self.scene.scale.low is None:
            found = "expected a scale with an interval, as SCENE/result.json has; found --scale"
            raise InputError(f"--show-interval: {found}")


def parse_pixel_position(text: str) -> PixelPosition | None:
    """Parse `frame=NAME_OR_INDEX,x=PX,y=PX`; None for `auto`. Raises InputError for anything else."""
    if text == "auto":
        return None
    fields = dict(part.split("=", 1) for part in text.split(",") if "=" in part)
    pixel = [number for name in ("x", "y") for number in stated_numbers(fields.get(name, ""))]
    if set(fields) != {"frame", "x", "y"} or len(pixel) != 2:
        raise InputError(f"--at: expected frame=NAME_OR_INDEX,x=PIXELS,y=PIXELS or auto; found {text!r}")
    return PixelPosition(fields["frame"], *pixel)


def parse_facing(text: str) -> float | str:
    """Parse `camera`, `wall`, or degrees from the direction to the camera. Raises InputError for anything else."""
    if text in ("camera", "wall"):
        return text
    degrees = stated_numbers(text)
    if len(degrees) != 1:
        raise InputError(f"--facing: expected camera, wall or degrees; found {text!r}")
    return degrees[0]


def parse_path(text: str) -> tuple[tuple[float, float], ...]:
    """Parse the corners of a path, `X,Y X,Y ...`. Raises InputError for anything else."""
    corners = []
    for token in text.split():
        corner = stated_numbers(token)
        if len(corner) != 2:
            raise InputError(f"--path: expected X,Y X,Y ... (pixels with --at, metres with --plane); found {token!r}")
        corners.append((corner[0], corner[1]))
    if not corners:
        raise InputError("--path: expected X,Y X,Y ... (pixels with --at, metres with --plane); found nothing")
    return tuple(corners)


def parse_frame_range(text: str) -> tuple[int, int]:
    """Parse FIRST:LAST, two indices of frames from 0. Raises InputError for anything else."""
    first, colon, last = text.partition(":")
    if not (colon and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
        raise InputError(f"--frames: expected FIRST:LAST, two indices of frames from 0; found {text!r}")
    return int(first), int(last)
