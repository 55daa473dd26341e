"""Options that differ from COLMAP's defaults: those of the table in docs/explanation/capture.md, and no others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from capture.mapping.features import MAIN
from capture.mapping.incremental import MIN_POSE_INLIERS, mapping_options, verification_options
from estimator.reconstructions.pycolmap_library import pycolmap

PAGE = Path("docs/explanation/capture.md")


def _flat(options: Any, prefix: str = "") -> dict[str, Any]:
    rows: dict[str, Any] = {}
    for name, value in options.todict().items():
        if isinstance(value, dict):
            rows |= {f"{prefix}{name}.{key}": inner for key, inner in value.items()}
        else:
            rows[f"{prefix}{name}"] = value
    return rows


def _changed(options: Any, default: Any) -> dict[str, Any]:
    before, after = _flat(default), _flat(options)
    return {name: after[name] for name in after if str(after[name]) != str(before[name])}


def test_the_main_strategy_has_the_features_of_colmap() -> None:
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    assert MAIN.max_features == extraction.sift.max_num_features
    assert MAIN.first_octave == extraction.sift.first_octave
    assert MAIN.peak == pytest.approx(extraction.sift.peak_threshold)
    assert MAIN.max_side == (extraction.max_image_size if extraction.max_image_size > 0 else 3200)
    assert (MAIN.pooled, MAIN.guided) == (extraction.sift.domain_size_pooling, matching.guided_matching)
    assert MAIN.ratio == pytest.approx(matching.sift.max_ratio)


def test_the_mapper_differs_in_the_options_of_the_table() -> None:
    camera = {"model": "SIMPLE_RADIAL", "params": None, "held": False}
    changed = _changed(mapping_options({"fixed": False}, camera), pycolmap.IncrementalPipelineOptions())
    assert changed == {
        "num_threads": 1,
        "random_seed": 0,
        "extract_colors": False,  # of the final model, once
        "mapper.abs_pose_min_num_inliers": MIN_POSE_INLIERS,
    }
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"`{name.split('.')[-1]}`" in page for name in changed)


def test_a_held_camera_is_not_refined() -> None:
    camera = {"model": "SIMPLE_RADIAL", "params": None, "held": True}
    free = mapping_options({"fixed": False}, camera | {"held": False})
    assert set(_changed(mapping_options({"fixed": False}, camera), free)) == {
        "ba_refine_focal_length",
        "ba_refine_extra_params",
        "mapper.abs_pose_refine_focal_length",
        "mapper.abs_pose_refine_extra_params",
    }
    fixed = mapping_options({"fixed": True}, camera | {"held": False})
    assert set(_changed(fixed, free)) == {"ba_refine_focal_length", "mapper.abs_pose_refine_focal_length"}


def test_the_verification_differs_in_its_seed() -> None:
    assert _changed(verification_options(), pycolmap.TwoViewGeometryOptions()) == {"ransac.random_seed": 0}
