"""What contact_implicit plans from starts without contact, and its forces beside MuJoCo's."""

from typing import TYPE_CHECKING

from fimpact.paper.plans import run_plans
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

with logged(snakemake.log[0]) as progress:
    plans, forces = run_plans(snakemake.params.config, snakemake.wildcards.system, progress)
    tables.write(plans, snakemake.output.plans)
    tables.write(forces, snakemake.output.forces)
