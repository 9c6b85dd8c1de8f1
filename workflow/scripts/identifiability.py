"""What a designed and a random experiment show of every parameter, in words."""

from typing import TYPE_CHECKING

from fimpact.paper.reach import run_identifiability
from fimpact.support import atomic_files
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    text = run_identifiability(snakemake.params.config, snakemake.wildcards.system)
    atomic_files.write_text(text, snakemake.output[0])
