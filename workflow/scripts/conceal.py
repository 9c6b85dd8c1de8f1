"""Effects planted, recorded and sealed: one part of the cases."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.benchmark.generator import conceal
from fimpact.benchmark.jsonl import as_lines
from fimpact.benchmark.plan import plan
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

params, output = snakemake.params, snakemake.output

with logged(snakemake.log[0]) as progress:
    cases = [case for case in plan(params.settings) if case.name in params.cases]
    rows = conceal(cases, params.settings, Path(output.recordings), Path(output.sealed), progress)
    atomic_files.write_text(as_lines(rows), output.made)
