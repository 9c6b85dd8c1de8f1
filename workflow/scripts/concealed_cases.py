"""One table from the parts that were scored."""

from typing import TYPE_CHECKING

from fimpact.benchmark.grading.score import gather
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    tables.write(gather(snakemake.input.parts), snakemake.output[0])
