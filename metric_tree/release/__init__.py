"""Releases on disk: files, schema, registry, images and publication."""

from metric_tree.release.release import MANIFEST, BadRelease, Release, open_release, publish_release

__all__ = ["MANIFEST", "BadRelease", "Release", "open_release", "publish_release"]
