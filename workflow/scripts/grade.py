"""The seals opened, and what other tools answered held against what was planted."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.challenge import grade_entered
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files = snakemake.input

with logged(snakemake.log[0]):
    rows = grade_entered(Path(files.entries), Path(files.recordings), Path(files.sealed))
    atomic_files.write_text(as_lines(rows), snakemake.output[0])
