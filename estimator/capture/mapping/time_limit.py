"""The time that a capture may take: every step is ended at the limit, and the best model so far is what counts."""

from __future__ import annotations

import time
from dataclasses import dataclass

__all__ = ["MAX_TIME_S", "SECONDS_PER_FRAME", "OutOfTime", "TimeLimit", "limit_of"]

#: Wall time in which frames become a model or a refusal, on two cores: the searches that helped on real pictures did so
#: within 6 minutes, and nobody waits longer than a coffee for a capture that needs to be recorded again.
MAX_TIME_S = 900.0
#: ... or so much a frame where that is more: the first search takes 1 to 3 s a frame.
SECONDS_PER_FRAME = 6.0


class OutOfTime(Exception):
    """A step was ended because its time was over."""


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """A moment on the monotonic clock, in seconds."""

    until_s: float

    @property
    def left_s(self) -> float:
        """Seconds that are left, 0 at least."""
        return max(self.until_s - time.monotonic(), 0.0)

    def within(self, seconds: float) -> TimeLimit:
        """The limit, or so many seconds from now if that is sooner."""
        return TimeLimit(min(self.until_s, time.monotonic() + seconds))


def limit_of(n_frames: int, max_time_s: float | None = None) -> TimeLimit:
    """The limit from now for so many frames; `max_time_s` : as the user has it."""
    return TimeLimit(time.monotonic() + (max_time_s or max(MAX_TIME_S, SECONDS_PER_FRAME * n_frames)))
