"""Size of a model in metres: that of its file, a stated extent, or the prior median of its category."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from metric_base.length_units import metres as metres_of
from models3d.model import Model

if TYPE_CHECKING:
    from metric_tree.tree import Tree

_STATED = re.compile(r"(length|width|height)=(.+)\Z", re.DOTALL)
#: Minimum and maximum extent of a plausible file, in metres. glTF prescribes metres; other files use another unit.
PLAUSIBLE_EXTENT_M = (0.002, 100.0)
#: Maximum stated extent in metres, larger than any building.
MAX_EXTENT_M = 10_000.0


@dataclass(frozen=True, slots=True)
class ModelSize:
    """Size of a model."""

    factor: float  #: factor on the metres of the file
    source: str  #: origin of the size, for messages
    warnings: tuple[str, ...] = ()


def model_size(model: Model, request: str, tree: Tree | None = None, category: str | None = None) -> ModelSize:
    """Return the size of a model.

    Parameters
    ----------
    model : Model
        The model in the metres of its file.
    request : str
        `file` (the metres of the file), `height=0.9` or `height=90cm` (also `length=`, `width=`), or `prior` (the
        median height of the category, else its length or width).
    tree : Tree, optional
        Release of the priors.
    category : str, optional
        Category of the object in the tree.

    Raises
    ------
    InputError
        The request is invalid, or the category has no known extent.
    """
    if request == "file":
        longest = max(model.size_m.values())
        if PLAUSIBLE_EXTENT_M[0] <= longest <= PLAUSIBLE_EXTENT_M[1]:
            return ModelSize(1.0, "file")
        how = "if that is wrong, use --size height=METRES"
        return ModelSize(1.0, "file", (f"{model.name}: is {longest:.4g} m long according to its file; {how}",))
    if request == "prior":
        if tree is None or category is None:
            raise InputError("--size prior: expected --category NAME, a category of the tree; found none")
        from metric_tree.tree import DETECTORS

        node = tree.find(category, DETECTORS)  # a word with several senses has that of the detectors' label lists
        dims = tuple(node.dims or ())
        axis = "height" if "height" in dims else next((d for d in dims if d in ("length", "width")), None)
        if axis is None:
            how = "expected a category with a known height, length or width"
            raise InputError(f"--size prior: {how}; found {node.node_id}")
        metres = float(node.outer(node.prior((axis,))).quantile(0.5)[0]) / 1000.0
        return ModelSize(metres / _extent(model, axis), f"prior of {node.node_id}: {axis} {metres:.3g} m")
    stated = _STATED.match(request)
    if stated is None:
        how = "expected file, prior, height=METRES, length=METRES or width=METRES"
        raise InputError(f"--size: {how}; found {request!r}")
    try:
        metres = metres_of(stated[2])
    except ValueError:
        metres = float("nan")
    if not 0 < metres <= MAX_EXTENT_M:
        raise InputError(f"--size {stated[1]}: expected metres above 0, at most {MAX_EXTENT_M:g}; found {stated[2]!r}")
    return ModelSize(metres / _extent(model, stated[1]), request)


def _extent(model: Model, axis: str) -> float:
    """Return the extent of a model along an axis. Raises InputError if it is zero."""
    extent = model.size_m[axis]
    if extent <= 0:
        raise InputError(f"--size {axis}: expected a model with a {axis}; {model.name} has none")
    return extent
