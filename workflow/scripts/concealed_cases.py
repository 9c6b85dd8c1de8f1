"""One table from the parts that were scored."""

from typing import TYPE_CHECKING

from fimpact import tables
from fimpact.concealed.score import gather
from fimpact.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    tables.write(gather(snakemake.input.parts), snakemake.output[0])
