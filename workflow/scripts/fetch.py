"""One data file from where it is published, its hash checked."""

from typing import TYPE_CHECKING

from fimpact.support.fetch import fetch
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    fetch(snakemake.params.source, snakemake.output[0])
    progress(f"{snakemake.params.source.file}: {snakemake.params.source.licence}")
