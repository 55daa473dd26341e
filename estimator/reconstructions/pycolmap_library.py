"""pycolmap, loaded after zlib, and without the handler of signals that it puts in place of the command's own.

Its wheel brings a zlib of its own, which breaks Python's if it comes first; its logger takes SIGTERM, prints a trace of
the stack and leaves temporary files behind.
"""

import zlib  # noqa: F401 - before pycolmap: afterwards `zlib.compressobj().flush()` hangs or aborts

import pycolmap

from metric_base.signals import keep_termination

__all__ = ["pycolmap"]

keep_termination()
