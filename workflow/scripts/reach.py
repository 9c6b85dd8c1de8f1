"""Does the design find contact from a start that has none?"""

from typing import TYPE_CHECKING

from fimpact.paper.reach import run_reach
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    table = run_reach(snakemake.params.config, snakemake.wildcards.system, progress)
    tables.write(table, snakemake.output[0])
