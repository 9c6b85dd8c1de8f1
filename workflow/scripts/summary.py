"""The numbers behind docs/paper.md: one row per system and method, and coverage."""

from typing import TYPE_CHECKING

from fimpact.paper import summary
from fimpact.support import atomic_files, tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files, output = snakemake.input, snakemake.output

with logged(snakemake.log[0]):
    diagnostics = tables.read(files.diagnostics)
    trials = tables.read(files.trials)
    table = summary.summarise(trials, diagnostics, tables.read(files.reach))
    coverage = summary.coverage(diagnostics, trials)
    tables.write(table, output.summary)
    tables.write(coverage, output.coverage)
    atomic_files.write_text(summary.to_markdown(table) + "\n" + summary.coverage_to_markdown(coverage), output.text)
