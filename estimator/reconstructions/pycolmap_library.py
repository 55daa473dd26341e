"""Import pycolmap without its side effects.

The wheel contains another zlib, which breaks the one of Python if it is loaded first. The logger of pycolmap replaces
the handler of SIGTERM by one that prints a stack trace and leaves temporary files, and it writes log files to the
temporary folder of the system.
"""

import signal
import threading
import zlib  # noqa: F401 - before pycolmap: afterwards `zlib.compressobj().flush()` hangs or aborts

import pycolmap

__all__ = ["pycolmap"]

if threading.current_thread() is threading.main_thread():
    _handler = signal.getsignal(signal.SIGTERM)  # pycolmap sets its handler below Python
    if callable(_handler):
        signal.signal(signal.SIGTERM, _handler)
for _level in (pycolmap.logging.INFO, pycolmap.logging.WARNING, pycolmap.logging.ERROR, pycolmap.logging.FATAL):
    pycolmap.logging.set_log_destination(_level, "")  # no file; errors are written to standard error
