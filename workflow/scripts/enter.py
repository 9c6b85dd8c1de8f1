"""Tools that others would enter, on their share of the cases."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.comparators.entered_tools import enter_part
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    rows = enter_part(Path(snakemake.input.recordings), snakemake.params.entered, progress)
    atomic_files.write_text(as_lines(rows), snakemake.output[0])
