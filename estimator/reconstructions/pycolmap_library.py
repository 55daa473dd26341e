"""pycolmap, loaded after zlib, without the handler of signals that it puts in place of the command's own, and its logs.

Its wheel brings a zlib of its own, which breaks Python's if it comes first; its logger takes SIGTERM, prints a trace of
the stack and leaves temporary files behind, and writes logs into the system's temporary folder.
"""

import zlib  # noqa: F401 - before pycolmap: afterwards `zlib.compressobj().flush()` hangs or aborts

import pycolmap

from metric_base.signals import keep_termination

__all__ = ["pycolmap"]

keep_termination()
for _level in (pycolmap.logging.INFO, pycolmap.logging.WARNING, pycolmap.logging.ERROR, pycolmap.logging.FATAL):
    pycolmap.logging.set_log_destination(_level, "")  # no file; what matters goes to standard error
