"""What the played experiments leave of the sets."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fimpact.benchmark.contestant import resolve_part
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files = snakemake.input

with logged(snakemake.log[0]) as progress, np.load(files.commands) as commands, np.load(files.revealed) as played:
    rows = resolve_part(Path(files.recordings), files.diagnoses, dict(commands), dict(played), progress)
    atomic_files.write_text(as_lines(rows), snakemake.output[0])
