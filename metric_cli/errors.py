"""Optional dependencies: which extra of the distribution brings a module that is missing."""

from __future__ import annotations

__all__ = ["MODULES_BY_EXTRA", "missing_extra"]

#: The modules that an extra of `pyproject.toml` brings. A module may be in several; the first is the one to name.
MODULES_BY_EXTRA: dict[str, tuple[str, ...]] = {
    "scene": ("cv2", "matplotlib", "PIL", "pycocotools", "pycolmap", "scipy", "sklearn"),
    "detect": ("onnxruntime",),
    "video": ("av",),
    "insert": ("moderngl",),
    "usd": ("pxr",),
    "crawl": ("scrapy", "lxml", "extruct", "redis", "twisted", "w3lib"),
    "build": ("nltk", "pooch", "requests", "xlrd", "yaml"),
    "images": ("rembg",),
    "assets": ("trimesh", "collada", "lxml"),
    "cluster": ("distributed",),
    "serve": ("jinja2", "markupsafe", "starlette", "uvicorn"),
    "mcp": ("mcp",),
    "pandas": ("pandas",),
    "view": ("open3d",),
}


def missing_extra(module: str | None) -> str | None:
    """The extra that brings a module, or None if no extra does.

    >>> missing_extra("scrapy.http")
    'crawl'
    """
    root = (module or "").partition(".")[0]
    return next((extra for extra, modules in MODULES_BY_EXTRA.items() if root in modules), None)
