"""A model that moves by itself: which of its animations plays, and the room that it takes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from models3d.model import Animation, Model

#: Poses of an animation, evenly over its time, that say how low and how wide it gets.
POSES = 16


@dataclass(frozen=True, slots=True, eq=False)
class Acting:
    """A model as it stands at first.

    motion : what plays, None where it stands still; bounds : (2, 3) corners of the first pose, the lower one as low as
    any pose, so that the object stands by its lowest moment; reach : (2, 3) corners of all poses.
    """

    model: Model
    motion: Animation | None
    bounds: FloatArray
    reach: FloatArray

    def at(self, time_s: float) -> Model:
        """The model at a time from the first picture."""
        return self.model if self.motion is None else self.model.at(self.motion, time_s)


def acting(model: Model, clip: str | None, at_time_s: float | None) -> Acting:
    """The model with its animation.

    clip : name or number of the animation, the first without, `none` for the file's own pose; at_time_s : the pose of
    this time, which does not change then. Raises InputError for an animation that the file does not have.
    """
    motion = _chosen(model, clip)
    if motion is None:
        if at_time_s is not None:
            raise InputError(f"--at-time: expected a model with an animation; {model.name} has none that plays")
        return Acting(model, None, model.bounds, model.bounds)
    first = model.at(motion, at_time_s or 0.0)
    if at_time_s is not None:
        return Acting(first, None, first.bounds, first.bounds)
    poses = [model.at(motion, k * motion.duration_s / POSES).bounds for k in range(POSES)]
    reach = np.array([np.min([low for low, _ in poses], axis=0), np.max([high for _, high in poses], axis=0)])
    bounds = first.bounds
    bounds[0, 1] = reach[0, 1]
    return Acting(replace(model, parts=first.parts), motion, bounds, reach)


def _chosen(model: Model, clip: str | None) -> Animation | None:
    if clip == "none" or (clip is None and not model.motions):
        return None
    if clip is None:
        return model.motions[0]
    named = next((motion for motion in model.motions if motion.name == clip), None)
    if named is None and clip.isdecimal() and int(clip) < len(model.motions):
        named = model.motions[int(clip)]
    if named is None:
        names = ", ".join(motion.name for motion in model.motions) or "no animation"
        raise InputError(f"--clip: expected none or one of {model.name} ({names}); found {clip!r}")
    return named
