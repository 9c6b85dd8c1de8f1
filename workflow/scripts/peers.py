"""The slow comparators, on their share of the cases."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.comparators.concealed_cases import compare_part
from fimpact.benchmark.jsonl import as_lines
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    params = snakemake.params
    rows = compare_part(Path(snakemake.input.recordings), params.compared, params.refitted, progress)
    atomic_files.write_text(as_lines(rows), snakemake.output[0])
