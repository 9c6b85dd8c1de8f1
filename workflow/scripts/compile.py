"""The programs of one system, traced and compiled into the cache before the jobs that share them."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.paper.information.programs import compile_programs
from fimpact.paper.systems import make_system
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    system, config = snakemake.wildcards.system, snakemake.params.config
    compile_programs(make_system(system, config["systems"][system]))
    progress(f"{system}: programs are in the cache")
    Path(snakemake.output[0]).write_text(f"{system}: compiled\n")
