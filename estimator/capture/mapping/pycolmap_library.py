"""pycolmap, loaded after zlib: its wheel brings a zlib of its own, which breaks Python's if it comes first."""

import zlib  # noqa: F401 - before pycolmap: afterwards `zlib.compressobj().flush()` hangs or aborts

import pycolmap

__all__ = ["pycolmap"]
