"""Error reduction against the share of random experiments that touch."""

from pathlib import Path
from typing import TYPE_CHECKING

from fimpact.paper.figures import panels as figures
from fimpact.paper.summary import reduction_curve
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]):
    sweep, trials = tables.read(snakemake.input.sweep), tables.read(snakemake.input.trials)
    tables.write(reduction_curve(sweep), snakemake.output.table)
    figures.curve(sweep, trials, Path(snakemake.output.svg).with_suffix(""))
