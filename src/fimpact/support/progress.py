"""What a job says while it runs: every line goes to the terminal and to its log at once."""

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


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
