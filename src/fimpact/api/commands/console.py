"""What a command prints while it works: lines, with the rate and the time left where they count what is done."""

import math
import re
import sys
import time
from collections.abc import Callable

from fimpact.cases.errors import printable

COUNTED = re.compile(r"(\d+) of (at most )?(\d+)")
SECOND = 1.0  # counts are told no more often


class Teller:
    """Prints what a job says while it runs; of a line that counts what is done, such as "step 3 of at most 20", the
    rate and the time that is left, too."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self.clock, self.last, self.told = clock, clock(), -math.inf
        self.begun: dict[str, tuple[float, int, int]] = {}  # by stage: since when, from what count on, and the last one

    def __call__(self, line: str) -> None:
        now, found = self.clock(), COUNTED.search(line)
        if found is None or now - self.told >= SECOND or found[1] == found[3]:
            print(printable(line + (self._pace(line, found, now) if found else "")), file=sys.stderr, flush=True)
            self.told = now
        elif found:
            self._pace(line, found, now)
        self.last = now

    def _pace(self, line: str, found: re.Match[str], now: float) -> str:
        stage, done, every = line[: found.start()], int(found[1]), int(found[3])
        begun, first, before = self.begun.get(stage, (self.last, max(done - 1, 0), every))
        if done <= before and stage in self.begun:  # it began again
            begun, first = self.last, max(done - 1, 0)
        self.begun[stage] = begun, first, done
        rate = (done - first) / max(now - begun, 1e-9)
        if done >= every or rate <= 0:
            return ""
        return f" ({rate:.2g} a second, {found[2] or ''}{(every - done) / rate:.0f} s left)"
