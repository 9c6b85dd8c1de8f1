import os
import re
import sys
from pathlib import Path

from fimpact.benchmark.plan import case_names, compared, entered
from fimpact.benchmark.settings import check as check_benchmark
from fimpact.paper.config import PLANAR, SEEN, check
from fimpact.support.fetch import find_source, read_sources
from fimpact.support.schema_check import check_keys

os.environ.setdefault("MPLBACKEND", "Agg")  # of every job: pictures go to files
KNOWN = sorted(path.stem for path in Path("config/recordings").glob("*.yaml") if path.stem != "sources")
SCHEMAS = Path(workflow.basedir) / "workflow" / "schemas"

try:
    apart = ("concealed", "recordings")
    check({key: table for key, table in config.items() if key not in apart}, SCHEMAS / "config.schema.yaml")
    check_benchmark({"concealed": config["concealed"]}, SCHEMAS / "concealed.schema.yaml")
    check_keys({"recordings": config["recordings"]}, SCHEMAS / "recordings.schema.yaml", case=KNOWN)
    SOURCES = read_sources("config/recordings/sources.yaml")
except ValueError as error:
    # Snakemake's WorkflowError would put the line number of this file around the one line that matters.
    sys.exit(str(error))

BENCHMARK = config["concealed"]
DATA = config["recordings"]["data"]
CASES = config["recordings"].get("cases", KNOWN)
MISSING = [source.file for source in SOURCES if not Path(DATA, source.file).exists()]
SYSTEMS, METHODS = config["select"]["systems"], config["select"]["methods"]
PLANNED = [system for system in SYSTEMS if system in PLANAR and "contact_implicit" in METHODS]
REFERENCE = [f"{name}.csv" for name in "trials diagnostics sweep reach summary".split()]
REFERENCE += [f"{name}.png" for name in "panels ablation curve".split()]
REFERENCE += ["plans.csv", "forces.png"] if PLANNED else []
REFERENCE += [f"example-{system}.{ending}" for system in SYSTEMS for ending in ("png", "gif")]


wildcard_constraints:
    system="|".join(config["systems"]),
    method="[a-z_]+",


def settings(*tables, **replaced):
    """Params function: the configuration as one job sees it, so that a change elsewhere does not rerun it."""

    def part(wildcards):
        system = {wildcards.system: config["systems"][wildcards.system]}
        return {"systems": system, **{table: config[table] for table in tables}, **replaced}

    return part


def designing(method, **replaced):
    """The part of the table `design` that the method looks at."""
    return {key: value for key, value in {**config["design"], **replaced}.items() if key in SEEN[method]}


def trial_settings(wildcards):
    """Params function: `settings` of one method's trials."""
    return settings("rounds", "estimate", design=designing(wildcards.method))(wildcards)


def sweep_settings(wildcards):
    """Params function: `settings` of one method's sweep."""
    sweep = {key: config["sweep"][key] for key in ("seeds", "rounds")}
    return settings("estimate", sweep=sweep, design=designing(wildcards.method, **config["sweep"]["design"]))(wildcards)


def seeds_of(method):
    """The seeds on which a method runs: those selected, or the first few of them."""
    seeds = config["select"]["seeds"]
    return seeds[: config["select"].get("first", {}).get(method, len(seeds))]


def parts(items, size):
    """Number of jobs that share `items`, at most `size` in each."""
    return -(-len(items) // size)


def sweep_seeds():
    """One entry for every seed at every surface of the sweep's longest list, to be split like the seeds."""
    return [seed for _ in max(config["sweep"]["surfaces"].values(), key=len) for seed in config["sweep"]["seeds"]]


def share(items, wildcards):
    """The part of `items` that the job `scatteritem`, such as 2-of-5, is to do."""
    number, count = map(int, wildcards.scatteritem.split("-of-"))
    return items[number - 1 :: count]


def scattered(names, items, pattern, **wildcards):
    """Files of all parts of `items` that are not empty: there may be more parts than items."""
    return expand(pattern, scatteritem=names("{scatteritem}")[: len(items)], **wildcards)


def pieces(table):
    """Files that make up one of the tables."""
    surfaces = config["sweep"]["surfaces"]
    if table == "reach":
        return expand("<results>/reach/{system}.csv", system=SYSTEMS)
    if table == "sweep":
        pattern, methods = "<results>/sweep/{system}-{method}-{scatteritem}.csv", config["sweep"]["methods"]
        jobs = [
            scattered(gather.surfaces, surfaces[system], pattern, system=system, method=methods) for system in SYSTEMS
        ]
        return [path for paths in jobs for path in paths]
    end = "" if table == "trials" else f"-{table}"
    pattern = f"<results>/trials/{{system}}-{{method}}-{{scatteritem}}{end}.csv"
    every = [
        scattered(gather.seeds, seeds_of(method), pattern, system=name, method=method)
        for name in SYSTEMS
        for method in methods_of(name)
    ]
    return [path for paths in every for path in paths]


def methods_of(system):
    """The methods that run for `system`: those selected, but contact_implicit only where it has rigid-body terms."""
    return [method for method in METHODS if method != "contact_implicit" or system in PLANAR]


def first_designs(system, method):
    """The designs file that holds the first seed."""
    pattern = "<results>/trials/{system}-{method}-{scatteritem}-designs.npz"
    return scattered(gather.seeds, config["select"]["seeds"][:1], pattern, system=system, method=method)


def everything():
    """The default target: what can be drawn and, unless the tables are given, what must be simulated."""
    drawn = ["panels.svg", "ablation.svg", "summary.md"] + ["curve.svg"] * ("tables" in config)
    simulated = expand(["example-{system}.gif", "identifiability-{system}.md"], system=SYSTEMS)
    simulated += ["forces.svg"] if PLANNED else []
    return expand("<results>/{name}", name=drawn if "tables" in config else drawn + simulated)


def part_of_cases(wildcards):
    """Names of the cases of one part."""
    return share(case_names(BENCHMARK), wildcards)


def compared_cases(share="compared"):
    """Params function: those of one part on which the slow comparators run."""
    return lambda wildcards: sorted(set(compared(BENCHMARK, share)) & set(part_of_cases(wildcards)))


def entered_cases():
    """Params function: those of one part that other tools enter."""
    return lambda wildcards: sorted(set(entered(BENCHMARK)) & set(part_of_cases(wildcards)))


def parts_of_cases(folder):
    """Files of all parts in `folder`, or of those that are there."""
    pattern = f"{BENCHMARK['results']}/{folder}/{{scatteritem}}.jsonl"
    every = scattered(gather.cases, case_names(BENCHMARK), pattern)
    if BENCHMARK.get("gathered", "all") == "all":
        return every
    return [path for path in every if Path(path).exists()] or sys.exit(
        f"{BENCHMARK['results']}/{folder} holds no part yet; leave out concealed.gathered, or wait until one is"
    )


def whole():
    """Whether all is made anew: neither a table that is given nor what is scored so far is to be read."""
    return "tables" not in BENCHMARK and BENCHMARK.get("gathered", "all") == "all"


def case_inputs(wildcards):
    """Input function: the files that a case reads. Ends with one line if one is neither there nor published."""
    from fimpact.cases import inputs  # here, because every `snakemake` reads this file and this takes a second

    try:
        files = inputs(f"config/recordings/{wildcards.case}.yaml", DATA)
    except ValueError as error:
        sys.exit(str(error))
    offered = {Path(DATA, file) for file in MISSING}
    absent = [str(file) for file in files if not file.exists() and file not in offered]
    if absent:
        sys.exit(
            f"{absent[0]} does not exist, and nobody offers it by URL; config/recordings/README.md says where to get it; "
            "put it there, or name the folder that has it: --config 'recordings={data: FOLDER}'"
        )
    return files
