"""Campaigns of one method on one system, for one part of the seeds."""

from typing import TYPE_CHECKING

from fimpact.paper.trial import run_trials
from fimpact.support import tables
from fimpact.support.progress import logged

if TYPE_CHECKING:
    from snakemake.iocontainers import snakemake

params, wildcards, output = snakemake.params, snakemake.wildcards, snakemake.output

with logged(snakemake.log[0]) as progress:
    trials = run_trials(params.config, wildcards.system, wildcards.method, params.seeds, progress)
    tables.write(trials.table, output.trials)
    tables.write(trials.diagnostics, output.diagnostics)
    tables.write_arrays(trials.designs, output.designs)
