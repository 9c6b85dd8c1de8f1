# The paper "Exciting Contact Modes in Differentiable Simulations for Robot Learning", from configuration to figures.
#   snakemake                                        everything, at the paper's size
#   snakemake --configfile config/smoke.yaml         the same graph in minutes
#   snakemake --configfile config/reference.yaml     figures and summary from the committed tables, in seconds
#   snakemake reference                              replace the committed tables by those just made
from snakemake.utils import min_version

min_version("9.27")


configfile: "config/config.yaml"


include: "workflow/rules/common.smk"


pathvars:
    results=config["results"],
    tables=config.get("tables", config["results"]),


report: "workflow/report/workflow.rst"


# Names the interpreter; without --sdm nothing is pulled, and jobs run in the environment of snakemake itself.
container: "docker://python:3.11-slim"


scattergather:
    seeds=parts(config["select"]["seeds"], config["seeds_per_job"]),
    surfaces=parts(sweep_seeds(), config["seeds_per_job"]),


localrules:
    all,
    reference,


rule all:
    input:
        everything(),


include: "workflow/rules/experiments.smk"
include: "workflow/rules/figures.smk"
