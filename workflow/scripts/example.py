"""A designed experiment beside a random one: a stroboscopic picture and a film."""

from typing import TYPE_CHECKING

from fimpact.paper.figures import examples
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

job = snakemake
files, pictures = job.input, dict(job.output.items())

with logged(job.log[0]):
    examples.draw(job.params.config, job.wildcards.system, files.fisher[0], files.uniform[0], pictures)
