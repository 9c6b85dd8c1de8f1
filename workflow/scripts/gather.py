"""One table from the parts that the jobs wrote."""

from typing import TYPE_CHECKING

from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    table = tables.gather(snakemake.input.parts, snakemake.params.systems, snakemake.params.methods)
    tables.write(table, snakemake.output[0])
