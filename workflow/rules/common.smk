import os
import re
import sys
from pathlib import Path

from fimpact.concealed.plan import case_names, compared, entered
from fimpact.concealed.settings import check as check_benchmark
from fimpact.paper.config import PLANAR, SEEN, check
from fimpact.support.fetch import find_source, read_sources
from fimpact.support.keys import check_keys

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

# The package files each stage depends on: editing one reruns the stages that list it. tests/test_workflow.py
# compares the lists with what the modules import.
MODEL = ["__init__", "paper/systems/__init__", "paper/systems/base"]
MODEL += [f"paper/mjx/{name}" for name in "runtime engine sensors rollout information traced programs".split()]
FORECAST = ["support/quiet", "paper/forecast"]
PLANNING = [f"paper/contact_implicit/{name}" for name in "bodies plan simulate step transcription".split()]
TABLES = ["support/tables", "support/drafts"]
TRIAL = [*MODEL, *FORECAST, *PLANNING, *TABLES]
TRIAL += [f"paper/{name}" for name in "truth design search estimate trial".split()]
EFFECTS = (
    "__init__ actuation amounts base classes contact drives environment friction gears masses native sensing servos sites "
    "structure transmission"
)
SHARED = ["__init__", *TABLES, "recordings", "concealed/__init__", "concealed/archive", "concealed/rows"]
RIGS = ["support/quiet"] + [
    f"concealed/{name}"
    for name in "crowd rig rigs planar robots planting plants strangers truth world at_bodies at_joints at_signals".split()
]
GRADING = "campaigns challenge crowded detect draw drawing grading motions places plan referee seal sizing split twins"
CASE = (
    "__init__ angles arrays case channels checks compiling errors exchanged kinds kinematics lerobot load "
    "misreadings model motion physics plausible quaternions readers ros rows runs sensor_ties sensors servo_ties "
    "sources start texts ties timebase units"
)
READ = ["__init__", "support/complaints", "recordings", "support/units", *(f"cases/{name}" for name in CASE.split())]
FORWARD = "added_forces horizon inputs model_pool nonsmooth servo_steps simulator starts windows".split()
SMOOTHER = (
    "commands filtering inverse kalman lateness laws levels linear parameters prepare refinement response rubbing smoother "
    "states step stretches track"
).split()
PROOF = [
    "support/quiet",
    "deciding",
    "recordings",
    "support/units",
    "support/visuals",
    "diagnosis/freed",
    "diagnosis/proof",
]
PROOF += [f"simulation/{name}" for name in FORWARD] + [f"smoothing/{name}" for name in SMOOTHER]
PROOF += [f"effects/{name}" for name in EFFECTS.split() if name != "classes"]
FINDING = [*PROOF, "smoothing/candidates", "smoothing/columns", "smoothing/simulated", "effects/classes"]
FINDING += [
    f"selection/{name}" for name in "begin drives exchange forward leftover limits options regression search".split()
]
SEEING = "diagnosed judging motion motions sight suspects wording".split()
FINDING += [f"identifiability/{name}" for name in SEEING]
FINDING += [f"diagnosis/{name}" for name in "findings notes pipeline remainder wording".split()]
DESIGNING = [f"experiments/{name}" for name in "described design limits separation".split()]
APART = ("diagnosis", "selection", "identifiability", "effects/classes")
FORCED = [name for name in FINDING if not name.startswith(APART)]
FORCED += ["diagnosis/proof", "selection/forced", "selection/regression"]
RIVALS = [f"comparators/{name}" for name in "random_features free_parameters toolboxes".split()]
EXPORT = [f"export/{name}" for name in "callback mjcf model player replay".split()]
STAGES = {
    "compile": MODEL,
    "trial": TRIAL,
    "reach": [*TRIAL, "paper/reach"],
    "plans": [*TRIAL, "paper/reach", "paper/plans"],
    "forces": ["__init__", *TABLES, "plotting/style", "paper/figures/forces"],
    "tables": TABLES,
    "summary": [*TABLES, "paper/measures", "paper/summary"],
    "figures": [*TABLES, "paper/measures", "paper/summary", "plotting/style"]
    + ["paper/figures/curve", "paper/figures/panels"],
    "conceal": [
        *SHARED,
        *RIGS,
        *(
            f"concealed/{name}"
            for name in "campaigns crowded detect draw drawing motions places plan referee seal sizing split twins".split()
        ),
    ],
    "diagnose": [*SHARED, *FINDING, *DESIGNING, *EXPORT, "experiments/resolve", "concealed/blind"],
    "peers": [*SHARED, *FORCED, "diagnosis/freed", *RIVALS, "concealed/peers"],
    "enter": [*SHARED, *PROOF, *RIVALS, "concealed/entered"],
    "grade": [*SHARED, *RIGS, "recordings", *(f"effects/{name}" for name in EFFECTS.split() if name != "classes")]
    + [f"concealed/{name}" for name in GRADING.split()],
    "score": [*SHARED, *FORCED, *RIGS] + [f"concealed/{name}" for name in "grading oracle places score seal".split()],
    "measures": ["__init__", *TABLES, *(f"concealed/{n}" for n in "__init__ lines measures strata".split())],
    "pictures": [
        "__init__",
        "plotting/style",
        *(f"concealed/{n}" for n in "__init__ lines measures confusion figures".split()),
    ],
    "examples": ["__init__", "paper/systems/__init__", "paper/systems/base"]
    + [f"paper/mjx/{name}" for name in "runtime engine sensors".split()]
    + [f"plotting/{name}" for name in "style scene stroboscopic gif".split()]
    + ["paper/figures/replay", "paper/figures/examples"],
    "diagnose_recording": [*READ, *FINDING, *DESIGNING, *EXPORT, *TABLES, "effects/fields", "effects/own"]
    + [f"plotting/{name}" for name in "style scene stroboscopic gif".split()]
    + [f"report/{name}" for name in "contents experiment figures film look motion numbers page".split()]
    + ["diagnosis/track_record", "commands/diagnose_recording"],
    "compare_recording": [*READ, *PROOF, *RIVALS, *TABLES, "commands/compare_recording"],
    "recordings_summary": ["__init__", *TABLES, "commands/rig_summary"],
}


wildcard_constraints:
    system="|".join(config["systems"]),
    method="[a-z_]+",


def code(stage, system=None):
    """Package files that `stage` depends on, with those of `system` if it simulates one."""
    own = [f"paper/systems/{system}.py", f"paper/systems/{system}.xml"] if system else []
    return [f"src/fimpact/{name}" for name in [f"{module}.py" for module in STAGES[stage]] + own]


def simulation(stage):
    """Input function: package files of a stage that simulates the system in the wildcards."""
    return lambda wildcards: code(stage, wildcards.system)


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
    drawn = ["panels.svg", "ablation.svg", "curve.svg", "summary.md"]
    simulated = expand(["example-{system}.gif", "identifiability-{system}.md"], system=SYSTEMS)
    simulated += ["forces.svg"] if PLANNED else []
    return expand("<results>/{name}", name=drawn if "tables" in config else drawn + simulated)


def planting():
    """Package files, and MJCF of the rigs, on which the robots depend."""
    return code("conceal") + [f"src/fimpact/concealed/{rig}.xml" for rig in BENCHMARK["rigs"]]


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


def diagnosing():
    """Package files on which a page depends."""
    return code("diagnose_recording") + ["src/fimpact/cases/schema.yaml", "src/fimpact/report/page.html.jinja"]
