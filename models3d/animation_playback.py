"""Choose the animation that an inserted model plays, and compute the space that it occupies over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from models3d.model import Animation, Model

#: Number of poses, evenly spaced over the duration, from which the bounds of an animation are computed.
N_POSES = 16


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """A model in its first pose, and the animation that moves it."""

    model: Model
    #: Animation that plays, or None if the model does not move.
    animation: Animation | None
    #: (2, 3) lowest and highest corner of the first pose in metres of the file. The lower height is that of all poses,
    #: so that the object touches its support at its lowest moment.
    bounds: FloatArray
    #: (2, 3) lowest and highest corner of all poses in metres of the file.
    bounds_over_time: FloatArray

    def posed(self, time_s: float) -> Model:
        """Return the model `time_s` seconds after the first frame."""
        return self.model if self.animation is None else self.model.posed(self.animation, time_s)


def select_playback(model: Model, clip: str | None, at_time_s: float | None) -> Playback:
    """Choose the animation of a model, or freeze the model in one of its poses.

    Parameters
    ----------
    model : Model
    clip : str, optional
        Name or number of an animation; `none` selects the pose of the file. The first animation by default.
    at_time_s : float, optional
        Freeze the model in the pose of this time, in seconds.

    Raises
    ------
    InputError
        The model does not have this animation, or `at_time_s` is given for a model without one.
    """
    animation: Animation | None = None
    if clip is None:
        animation = model.animations[0] if model.animations else None
    elif clip != "none":
        animation = next((animation for animation in model.animations if animation.name == clip), None)
        if animation is None and clip.isdecimal() and int(clip) < len(model.animations):
            animation = model.animations[int(clip)]
        if animation is None:
            names = ", ".join(animation.name for animation in model.animations) or "no animation"
            raise InputError(f"--clip: expected none or one of {model.name} ({names}); found {clip!r}")
    if animation is None:
        if at_time_s is not None:
            raise InputError(f"--at-time: expected a model with an animation; {model.name} has none that plays")
        return Playback(model, None, model.bounds, model.bounds)
    first = model.posed(animation, at_time_s or 0.0)
    if at_time_s is not None:
        return Playback(first, None, first.bounds, first.bounds)
    poses = [model.posed(animation, k * animation.duration_s / N_POSES).bounds for k in range(N_POSES)]
    over_time = np.array([np.min([low for low, _ in poses], axis=0), np.max([high for _, high in poses], axis=0)])
    bounds = first.bounds
    bounds[0, 1] = over_time[0, 1]
    return Playback(replace(model, meshes=first.meshes), animation, bounds, over_time)
