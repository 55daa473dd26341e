"""SMPTE time codes: that of a frame so many frames after another."""

from __future__ import annotations

import re

__all__ = ["time_code_after"]

_CODE = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d)")


def time_code_after(code: str, frames: int, rate: float) -> str:
    """The time code `frames` frames after one (HH:MM:SS:FF) at a rate in frames a second; others stay as they are.

    With `;` or `.` before the frames, two numbers are dropped in each minute but every tenth (four at 60 a second).
    """
    match = _CODE.fullmatch(code)
    whole = round(rate)
    if match is None or whole < 1:
        return code
    hours, minutes, seconds, number = (int(match[k]) for k in (1, 2, 3, 5))
    dropped = whole // 15 if match[4] in ";." else 0
    past = 60 * hours + minutes
    count = (60 * past + seconds) * whole + number - dropped * (past - past // 10) + frames
    in_ten, in_minute = 600 * whole - 9 * dropped, 60 * whole - dropped
    tens, rest = divmod(count, in_ten)
    count += dropped * (9 * tens + max(rest - dropped, 0) // in_minute)
    seconds, number = divmod(count, whole)
    return f"{seconds // 3600 % 24:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{match[4]}{number:02}"
