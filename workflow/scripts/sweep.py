"""Campaigns of one method on one system, with its surface in one or several places."""

from typing import TYPE_CHECKING

import pandas as pd

from fimpact.paper.trial import run_sweep
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

params, wildcards = snakemake.params, snakemake.wildcards

with logged(snakemake.log[0]) as progress:
    runs = [run_sweep(params.config, wildcards.system, wildcards.method, at, progress) for at in params.surfaces]
    tables.write(pd.concat(runs), snakemake.output[0])
