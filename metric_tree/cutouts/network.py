"""Foregrounds by a network through rembg: an open model by name, or a local ONNX file with the inputs of U2-Net."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.errors import InputError
from metric_tree.cutouts.backend import RGB, Foreground

#: Open models of rembg by name, with the licence of their weights; the default model of rembg is not open.
MODELS = {"u2net": "Apache-2.0", "u2netp": "Apache-2.0", "isnet-general-use": "Apache-2.0", "silueta": "Apache-2.0"}

#: Environment variable of the folder of weights of rembg; a custom file must be inside.
_HOME = "U2NET_HOME"


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A loaded network."""

    session: Any
    method: str  #: `rembg:<model or file name>`.

    @classmethod
    def load(cls, model: str) -> Network:
        """Load a network by the name of a model or from an ONNX file; rembg downloads missing weights.

        Raises
        ------
        InputError
            The model or file does not exist, the file is not a network, or the weights cannot be downloaded.
        """
        _check(model)
        rembg = _rembg()
        path = Path(model)
        try:
            with _home(path.parent if path.suffix == ".onnx" else None):
                if path.suffix == ".onnx":
                    session = rembg.new_session("u2net_custom", model_path=str(path.resolve()))
                else:
                    session = rembg.new_session(model)
        except OSError as error:  # requests.ConnectionError is one
            first = str(error).splitlines()[0][:80]
            raise InputError(
                f"--model {model}: expected weights in the cache or a network to fetch them; found {first}"
                "; `--backend plain` needs neither"
            ) from None
        except Exception as error:  # noqa: BLE001 - onnxruntime's errors share no base
            first = str(error).splitlines()[0][:120]
            raise InputError(f"--model {model}: expected an ONNX network; found {first}") from None
        return cls(session, f"rembg:{path.stem if path.suffix == '.onnx' else model}")

    def foreground(self, image: RGB) -> Foreground:
        """Return the soft mask (h, w) of an image (h, w, 3)."""
        from PIL import Image

        with np.errstate(invalid="ignore"):  # a blank image gives 0 / 0, which rembg turns into an empty mask
            mask = _rembg().remove(Image.fromarray(image), session=self.session, only_mask=True)
        return Foreground(np.asarray(mask.convert("L"), np.uint8), self.method)


def has_weights(model: str) -> bool:
    """Return True if rembg and the weights of a model are installed, without the import of rembg, which takes seconds.

    Raises
    ------
    InputError
        The model or file does not exist.
    """
    _check(model)
    if find_spec("rembg") is None or find_spec("onnxruntime") is None:
        return False
    if Path(model).suffix == ".onnx":
        return True
    data, named, name = os.environ.get("XDG_DATA_HOME"), os.environ.get(_HOME), f"{model}.onnx"
    homes = [named or f"{data or '~'}/.u2net"]  # the flat folder of older versions
    if not named:
        homes.append(os.environ.get("REMBG_HOME") or (f"{data}/rembg" if data else "~/.rembg"))
    folders = [Path(home).expanduser() for home in homes]
    return any((home / "models" / model / name).is_file() or (home / name).is_file() for home in folders)


def _check(model: str) -> None:
    if Path(model).suffix == ".onnx":
        if not Path(model).is_file():
            raise InputError(f"--model: expected an ONNX file; found none at {model}")
    elif model not in MODELS:
        raise InputError(f"--model: expected one of {', '.join(MODELS)} or an ONNX file; found {model!r}")


def _rembg() -> Any:
    """Import rembg when it is used: it loads numba and takes a second, the first time half a minute."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # onnxruntime reads it once, when it is imported
    try:
        import onnxruntime  # noqa: F401 - without it rembg ends the program
        import rembg
    except ImportError:
        raise InputError(
            "--backend rembg: expected rembg and onnxruntime; found none"
            " (pip install 'metric-tree[images]'); `--backend plain` needs neither"
        ) from None
    return rembg


@contextmanager
def _home(folder: Path | None) -> Iterator[None]:
    """Change the folder of weights of rembg, which refuses a custom file elsewhere, while the block runs."""
    before = os.environ.get(_HOME)
    if folder is not None:
        os.environ[_HOME] = str(folder.resolve())
    try:
        yield
    finally:
        if folder is not None:
            os.environ.pop(_HOME)
            if before is not None:
                os.environ[_HOME] = before
