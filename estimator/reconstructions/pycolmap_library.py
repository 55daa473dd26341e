"""pycolmap, loaded after zlib, without the handler of signals that it puts in place of the command's own, and its logs.

Its wheel brings a zlib of its own, which breaks Python's if it comes first; its logger takes SIGTERM, prints a trace of
the stack and leaves temporary files behind, and writes logs into the system's temporary folder.
"""

import signal
import threading
import zlib  # noqa: F401 - before pycolmap: afterwards `zlib.compressobj().flush()` hangs or aborts

import pycolmap

__all__ = ["pycolmap"]

if threading.current_thread() is threading.main_thread():
    _handler = signal.getsignal(signal.SIGTERM)  # as Python knows it: pycolmap's own is set below Python
    if callable(_handler):
        signal.signal(signal.SIGTERM, _handler)
for _level in (pycolmap.logging.INFO, pycolmap.logging.WARNING, pycolmap.logging.ERROR, pycolmap.logging.FATAL):
    pycolmap.logging.set_log_destination(_level, "")  # no file; what matters goes to standard error
