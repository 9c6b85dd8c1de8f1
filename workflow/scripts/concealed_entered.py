"""One table of what other tools answered, from the parts that were graded."""

from typing import TYPE_CHECKING

from fimpact.benchmark.grading.answers import gather_entered
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    tables.write(gather_entered(snakemake.input.parts), snakemake.output[0])
