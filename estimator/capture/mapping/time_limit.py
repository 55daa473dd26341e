"""The time that a capture may take: every step is ended at the limit, and the best model so far is what counts."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

__all__ = ["MAX_TIME_S", "SECONDS_PER_FRAME", "OutOfTime", "TimeLimit", "limit_of", "processor_s"]

#: Processor time in which frames become a model or a refusal: the searches that helped on real pictures did so within
#: 6 minutes. It is no wall time, for with that a busy machine refuses what an idle one reconstructs.
MAX_TIME_S = 900.0
#: ... or so much a frame where that is more: the first search takes 1 to 3 s a frame.
SECONDS_PER_FRAME = 6.0
#: Whatever the load, a limit of processor time ends after so many times as much wall time: a worker that hangs uses no
#: processor.
MOST_WALL = 10.0


class OutOfTime(Exception):
    """A step was ended because its time was over."""


def processor_s() -> float:
    """Seconds of processor that this process has used, and those of its workers that have ended."""
    return sum(os.times()[:4])


@dataclass(frozen=True, slots=True)
class TimeLimit:
    """A moment in seconds on the monotonic clock or, with `of_processor`, on that of `processor_s`."""

    until_s: float
    of_processor: bool = False

    def now_s(self) -> float:
        """What its clock shows."""
        return processor_s() if self.of_processor else time.monotonic()

    @property
    def left_s(self) -> float:
        """Seconds that are left, 0 at least."""
        return max(self.until_s - self.now_s(), 0.0)

    @property
    def wall_left_s(self) -> float:
        """Seconds of wall time after which a step is ended in any case."""
        return self.left_s * (MOST_WALL if self.of_processor else 1.0)

    @property
    def worker_s(self) -> int | None:
        """Whole seconds of processor that a worker may use, None where wall time is what counts."""
        return int(self.left_s) + 1 if self.of_processor else None

    def within(self, seconds: float) -> TimeLimit:
        """The limit, or so many seconds from now if that is sooner."""
        return TimeLimit(min(self.until_s, self.now_s() + seconds), self.of_processor)


def limit_of(n_frames: int, max_time_s: float | None = None) -> TimeLimit:
    """The limit from now for so many frames; `max_time_s` : wall time, as the user has it."""
    if max_time_s is not None:
        return TimeLimit(time.monotonic() + max_time_s)
    return TimeLimit(processor_s() + max(MAX_TIME_S, SECONDS_PER_FRAME * n_frames), of_processor=True)
