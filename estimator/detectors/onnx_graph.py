"""A detector's ONNX graph: loaded, and run with bounds on time and memory."""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.errors import InputError, Unquoted

__all__ = ["graph_answers", "load_graph"]

#: Bytes of address space that a run may add: the largest Mask R-CNN takes 4 GB for a large picture.
RUN_BYTES = 12 << 30
#: Seconds that a detector may take for one picture; a large Mask R-CNN takes ten.
PICTURE_SECONDS = 300.0
#: Of onnxruntime's five levels of messages the last: its warnings quote names of the graph as they are.
FATAL = 4
#: onnxruntime writes a device id under the user's cache unless this is set before its import.
TELEMETRY_VARIABLE = "ORT_DISABLE_TELEMETRY"


def load_graph(path: Path) -> Any:
    """The session of a graph. InputError where onnxruntime is missing or does not load the file."""
    os.environ.setdefault(TELEMETRY_VARIABLE, "1")
    try:
        import onnxruntime
    except ImportError:
        expected = "onnxruntime (pip install 'metric-tree[images]')"
        raise InputError.at(path, "detector", expected, Unquoted("not installed")) from None
    options = onnxruntime.SessionOptions()
    options.log_severity_level = FATAL
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=onnxruntime.get_available_providers())
    except Exception as error:  # noqa: BLE001 - its errors have no common base that it exports
        line = (str(error).splitlines() or ["an error"])[0]
        raise InputError.at(path, "detector", "an ONNX graph that onnxruntime loads", Unquoted(line)) from None


def graph_answers(session: Any, path: Path, outputs: list[str] | None, feeds: dict[str, Any]) -> list[NDArray[Any]]:
    """What the graph answers, arrays of any shape; its error is the file's. feeds : arrays by input name."""
    import onnxruntime

    options = onnxruntime.RunOptions()
    options.log_severity_level = FATAL
    limit = threading.Timer(PICTURE_SECONDS, setattr, (options, "terminate", True))
    limit.daemon = True
    limit.start()
    try:
        with _bounded_memory():
            return [np.asarray(answer) for answer in session.run(outputs, feeds, options)]
    except Exception as error:  # noqa: BLE001 - onnxruntime's errors have no common base that it exports
        line = (str(error).splitlines() or ["an error"])[0]
        shape = next(iter(feeds.values())).shape
        raise InputError.at(path, "run", f"an answer to a picture of shape {shape}", Unquoted(line)) from None
    finally:
        limit.cancel()


@contextmanager
def _bounded_memory() -> Iterator[None]:
    """Within the block the process may grow by `RUN_BYTES`: a graph of a hundred bytes can ask for terabytes."""
    if not sys.platform.startswith("linux"):  # the size of the process is read where Linux states it
        yield
        return
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([pages * resource.getpagesize() + RUN_BYTES, *limits]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
