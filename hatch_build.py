"""Hatch's build hook: the shipped releases and their images in the wheel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WheelData(BuildHookInterface):
    """Adds the releases that pyproject.toml names, and from the shared store the images that these releases name.

    The store `data/images` also has the images of older releases, which the wheel does not contain.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Map paths in the repository to paths in the wheel; an editable install reads the repository itself."""
        if version == "editable":
            return
        releases = self.config["releases"]
        manifests = (Path(self.root, release, "manifest.json").read_text(encoding="utf-8") for release in releases)
        names = {name for manifest in manifests for name in json.loads(manifest)["extras"]}
        images = sorted(name.removeprefix("pictures/") for name in names if name.startswith("pictures/"))
        paths = [*releases, *(f"data/images/{image}" for image in images)]
        build_data["force_include"] |= {path: f"metric_tree/{path}" for path in paths}
