# The paper "Exciting Contact Modes in Differentiable Simulations for Robot Learning", from configuration to figures,
# and the blind benchmark of what the package says when the model is wrong.
#   snakemake                                        the paper's comparison and its figures, at its size
#   snakemake curve                                  when does it pay? the same with surfaces nearer and farther
#   snakemake --configfile config/ablation.yaml      all six methods on all seeds, in the same folder
#   snakemake --configfile config/smoke.yaml         the same graph in minutes
#   snakemake --configfile config/reference.yaml     figures and summary from the committed tables, in seconds
#   snakemake reference                              replace the committed tables by those just made
#   snakemake concealed                              the blind benchmark, as config/concealed.yaml has it
#   snakemake concealed --configfile config/concealed-smoke.yaml                   the same graph on eight cases
#   snakemake recordings                             diagnose and compare every case of config/recordings
#   snakemake results/recordings/CASE/report.html    one of them
#   snakemake fetch_all                              the data files that are published as the cases read them
from snakemake.utils import min_version

min_version("9.27")


configfile: "config/config.yaml"
configfile: "config/concealed.yaml"
configfile: "config/recordings.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/package_files.smk"


pathvars:
    results=config["results"],
    tables=config.get("tables", config["results"]),
    concealed=BENCHMARK["results"],
    recordings=config["recordings"]["results"],
    concealed_tables=BENCHMARK.get("tables", BENCHMARK["results"]),


report: "workflow/report/workflow.rst"


# Names the interpreter; without --sdm nothing is pulled, and jobs run in the environment of snakemake itself.
container: "docker://python:3.11-slim"


scattergather:
    seeds=parts(config["select"]["seeds"], config["seeds_per_job"]),
    surfaces=parts(sweep_seeds(), config["seeds_per_job"]),
    cases=parts(case_names(BENCHMARK), BENCHMARK["cases_per_job"]),


localrules:
    all,
    reference,
    concealed,
    concealed_reference,
    fetch_all,
    recordings,
    recordings_reference,


rule all:
    input:
        everything(),


include: "workflow/rules/experiments.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/concealed.smk"
include: "workflow/rules/recordings.smk"
