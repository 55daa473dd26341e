"""The size in metres at which a model is inserted."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from models3d.model import Model

if TYPE_CHECKING:
    from metric_tree.tree import Tree

_STATED = re.compile(r"(length|width|height)=([0-9.eE+-]+)\Z")
#: A model's file is in metres by glTF's rule; one larger or smaller than this was made in another unit.
PLAUSIBLE_M = (0.002, 100.0)


@dataclass(frozen=True, slots=True)
class SizeUsed:
    """The factor on the file's metres, where it comes from, and what is odd about it."""

    factor: float
    source: str
    warnings: tuple[str, ...] = ()


#: Metres of the largest object that is inserted: larger than anything that was built.
LARGEST_M = 10_000.0


def model_size(model: Model, request: str, tree: Tree | None = None, category: str | None = None) -> SizeUsed:
    """The size that `--size` asks for.

    request : `file` (the file's own metres), `height=0.9` (also `length=`, `width=`, metres), or `prior` (the median
    height of the category in the tree). Raises InputError for anything else.
    """
    if request == "file":
        return SizeUsed(1.0, "file", _plausible(model))
    if request == "prior":
        return _prior_size(model, tree, category)
    stated = _STATED.match(request)
    if stated is None:
        raise InputError(
            f"--size: expected file, prior, height=METRES, length=METRES or width=METRES; found {request!r}"
        )
    try:
        metres = float(stated[2])
    except ValueError:
        metres = float("nan")
    if not 0 < metres <= LARGEST_M:
        raise InputError(f"--size {stated[1]}: expected metres above 0, {LARGEST_M:g} at most; found {stated[2]!r}")
    return SizeUsed(metres / _extent(model, stated[1]), request)


def _extent(model: Model, name: str) -> float:
    extent = model.size_m[name]
    if extent <= 0:
        raise InputError(f"--size {name}: expected a model with a {name}; {model.name} has none")
    return extent


def _plausible(model: Model) -> tuple[str, ...]:
    largest = max(model.size_m.values())
    if PLAUSIBLE_M[0] <= largest <= PLAUSIBLE_M[1]:
        return ()
    return (
        f"{model.name}: its file says that it is {largest:.4g} m long; if that is not so, use --size height=METRES",
    )


def _prior_size(model: Model, tree: Tree | None, category: str | None) -> SizeUsed:
    if tree is None or category is None:
        raise InputError("--size prior: expected --category NAME, a category of the tree; found none")
    from metric_tree.tree import DETECTORS

    node = tree.find(category, DETECTORS)  # a bat of a scene is a stick, as detectors mean it
    dims = tuple(node.dims or ())
    name = "height" if "height" in dims else next((d for d in dims if d in ("length", "width")), None)
    if name is None:
        raise InputError(
            f"--size prior: expected a category with a known height, length or width; found {node.node_id}"
        )
    median_mm = float(node.prior((name,)).quantile(0.5)[0])
    return SizeUsed(
        median_mm / 1000.0 / _extent(model, name), f"prior of {node.node_id}: {name} {median_mm / 1000:.3g} m"
    )
