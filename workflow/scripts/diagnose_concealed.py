"""What is missing, from recordings alone; and the experiments that would split a set."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.contestant import diagnose_part
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files, tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    rows, commands = diagnose_part(Path(snakemake.input.recordings), progress)
    tables.write_arrays(commands, snakemake.output.commands)
    atomic_files.write_text(as_lines(rows), snakemake.output.diagnoses)
