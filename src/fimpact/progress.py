"""What a job says while it runs: every line goes to the terminal and to its log at once."""

import math
import os
import re
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fimpact.cases.errors import printable

COUNTED = re.compile(r"(\d+) of (at most )?(\d+)")
SECOND = 1.0  # counts are told no more often


@contextmanager
def logged(path: str | Path) -> Iterator[Callable[[str], None]]:
    """A function that reports a line; an exception ends the job with its traceback in the log.

    Snakemake shows the log of a failed job, so the terminal needs no second copy.
    """
    parent = os.getppid()
    with open(path, "w", buffering=1) as log:

        def report(line: str) -> None:
            if os.getppid() != parent:
                raise SystemExit("snakemake is gone (killed?), and the next one starts this job again")
            print(line, file=log)
            print(line, file=sys.stderr, flush=True)

        try:
            yield report
        except KeyboardInterrupt:
            raise SystemExit("interrupted") from None
        except Exception:
            traceback.print_exc(file=log)
            raise SystemExit(1) from None


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

    def _pace(self, line: str, found: re.Match, now: float) -> str:
        stage, done, every = line[: found.start()], int(found[1]), int(found[3])
        begun, first, before = self.begun.get(stage, (self.last, max(done - 1, 0), every))
        if done <= before and stage in self.begun:  # it began again
            begun, first = self.last, max(done - 1, 0)
        self.begun[stage] = begun, first, done
        rate = (done - first) / max(now - begun, 1e-9)
        if done >= every or rate <= 0:
            return ""
        return f" ({rate:.2g} a second, {found[2] or ''}{(every - done) / rate:.0f} s left)"
