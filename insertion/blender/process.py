"""Where Blender is, and one run of it.

Blender is GPL and wants an exact Python: it never runs in our process. `METRIC_TREE_BLENDER` names a `blender` program
or the Python of an environment that has `bpy`; without it, `blender` on PATH is used.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_base.progress import ProgressCallback, silent

__all__ = ["VARIABLE", "blender_program", "run_blender"]

VARIABLE = "METRIC_TREE_BLENDER"
#: Seconds between two looks at what is done.
POLL_S = 0.2
_SCRIPT = Path(__file__).with_name("script.py")


def blender_program() -> list[str]:
    """The words that run a script in Blender. Raises InputError where there is no Blender."""
    stated = os.environ.get(VARIABLE)
    program = shutil.which(stated or "blender")
    if program is None:
        how = f"install Blender, or set {VARIABLE} to the Python of an environment with bpy (pip install bpy)"
        reason = f"found no program {stated!r}" if stated else "found no blender on PATH"
        raise InputError(f"--renderer blender: {reason}; {how}")
    if "python" in Path(program).name:
        return [program, str(_SCRIPT)]
    return [program, "--background", "--factory-startup", "--python", str(_SCRIPT), "--"]


def run_blender(job: Mapping[str, Any], folder: Path, progress: ProgressCallback = silent) -> None:
    """Run one job (`script.py` says what is in it); `folder` takes its files. Raises InputError if Blender fails."""
    file = folder / "job.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    # Blender's Python must not see our packages
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    pictures = len(job["keys"]) if job.get("out") else 0
    status, log = _run([*blender_program(), str(file)], clean, folder, pictures, progress)
    if status != 0 or "Traceback" in log:
        last = next((line for line in reversed(log.splitlines()) if line.strip()), "no word")
        raise InputError(f"--renderer blender: Blender ended with status {status}: {last.strip()}")


def _run(
    words: list[str], environment: Mapping[str, str], folder: Path, pictures: int, progress: ProgressCallback
) -> tuple[int, str]:
    """The status of a program and what it said; its progress is the number of pictures in its folder."""
    file = folder / "log.txt"
    with file.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(words, stdout=log, stderr=subprocess.STDOUT, env=dict(environment))
        try:
            while process.poll() is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(POLL_S)
                progress("Cycles", len(list(folder.glob("*.npy"))), pictures or None)
        finally:  # Ctrl-C ends it, too
            if process.poll() is None:
                process.kill()
                process.wait()
    return process.returncode, file.read_text(encoding="utf-8", errors="replace")
