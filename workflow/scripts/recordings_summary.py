"""All rigs in one table: our held-out errors beside those of others."""

from typing import TYPE_CHECKING

from fimpact.benchmark.comparators import rig_summary
from fimpact.support import atomic_files, tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

files, output, rigs = snakemake.input, snakemake.output, snakemake.params.rigs

with logged(snakemake.log[0]):
    compared = dict(zip(rigs, files.compared, strict=True))
    summary = rig_summary.summarise(dict(zip(rigs, files.diagnoses, strict=True)), compared)
    tables.write(summary, output.summary)
    tables.write(rig_summary.gather(compared), output.peers)
    atomic_files.write_text(rig_summary.to_markdown(summary), output.text)
