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

# The package files each stage depends on: editing one reruns the stages that list it. tests/test_workflow.py
# compares the lists with what the modules import.
MODEL = ["__init__", "paper/systems/__init__", "paper/systems/base"]


def of(package, modules):
    """Package files of `modules`, names in one text, of one package."""
    return [f"{package}/{name}" for name in modules.split()]


MODEL += of("paper/mjx", "engine runtime sensors") + of("paper/information", "fisher programs rollout traced")
FORECAST = ["support/mujoco_setup", "paper/forecast"]
PLANNING = of("paper/contact_implicit", "bodies plan simulate step transcription")
TABLES = ["support/tables", "support/atomic_files"]
TRIAL = [*MODEL, *FORECAST, *PLANNING, *TABLES]
TRIAL += of("paper", "reference_simulator design search estimate task trial")
FAMILIES = "actuation contact environment friction masses sensing servos structure transmission"
CATALOGUE = of("effects", "__init__ base drives gears law_inputs native priors sites touching typical wiring") + of(
    "effects/families", FAMILIES
)
SHARED = ["__init__", *TABLES, "recordings", *of("benchmark", "archive jsonl")]
ROBOTS = ["support/mujoco_setup", "benchmark/truth", *of("benchmark/rigs", "planar registry rig robots")]
ROBOTS += of(
    "benchmark/planting",
    "bodies contacts crowd ground_truth joints out_of_catalogue plant planted_effects servos signals",
)
DRAWING = of("benchmark", "generator plan seal site_equivalence") + ["benchmark/planting/confusable_pairs"]
DRAWING += of(
    "benchmark/drawing",
    "campaigns crowded_case detectability draw_case effect_size ingredients motions separable tangents",
)
READ = ["__init__", "support/schema_errors", "recordings", "support/channel_units"]
READ += of(
    "cases",
    "__init__ added_sensors angles case case_file channels enums errors initial_state quaternions raw_runs resampling row_order runs units",
)
READ += of("cases/models", "compiling naive plausible")
READ += of("cases/readers", "arrays arrow_tables columns files lerobot ros texts")
READ += of(
    "cases/consistency",
    "balance checks columns_alone dynamics exchanged kinematics measured_motion misreadings sensor_ties servo_ties silent_columns ties",
)
PROOF = ["deciding", "recordings", *of("support", "channel_units mujoco_setup visual_meshes"), *CATALOGUE]
PROOF += of("diagnosis", "freed_model held_out")
PROOF += of(
    "simulation",
    "added_forces compiled horizon hypothesis inputs model_pool nonsmooth servo_steps simulator state_guess window_fit windows",
)
PROOF += of("smoothing", "noise_levels parameters prepare servo_lag smoother states step stretches time_step")
PROOF += of(
    "smoothing/dynamics",
    "body_inertia dry_friction inverse laws linear plain_motors plant response sampled_commands side_by_side track",
)
PROOF += of("smoothing/filter", "by_run kalman")
FINDING = [*PROOF, *of("smoothing", "candidates columns simulated_laws"), "effects/classes"]
FINDING += of(
    "selection",
    "forward one_round options pruning refit_start regression rivals search_scope servo_drives substitutes unnamed_rest",
)
FINDING += of(
    "diagnosis/identifiability",
    "advice blind_spots judging motion_model proposed_motions quick_look sentences suspects",
)
FINDING += of("diagnosis", "notes pipeline remainder") + of("diagnosis/wording", "certainty verdict")
DESIGNING = of("diagnosis/experiments", "design_space next_experiment predicted_separation separating")
APART = ("diagnosis", "selection", "effects/classes")
FORCED = [name for name in FINDING if not name.startswith(APART)]
FORCED += ["diagnosis/held_out", *of("selection", "forced regression")]
RIVALS = of("benchmark/comparators", "free_parameters random_features toolboxes")
EXPORT = of("export", "callback improved_model mjcf replay runtime_template")
PICTURES = of("report/plotting", "gif scene stroboscopic style")
STAGES = {
    "compile": MODEL,
    "trial": TRIAL,
    "reach": [*TRIAL, "paper/reach"],
    "plans": [*TRIAL, "paper/reach", "paper/plans"],
    "forces": ["__init__", *TABLES, "report/plotting/style", "paper/figures/forces"],
    "tables": TABLES,
    "summary": [*TABLES, "paper/measures", "paper/summary"],
    "figures": [*TABLES, "report/plotting/style", *of("paper", "measures summary figures/curve figures/panels")],
    "conceal": [*SHARED, *ROBOTS, *DRAWING],
    "diagnose": [*SHARED, *FINDING, *DESIGNING, *EXPORT, "diagnosis/experiments/resolve", "benchmark/contestant"],
    "peers": [*SHARED, *FORCED, "diagnosis/freed_model", *RIVALS, "benchmark/comparators/concealed_cases"],
    "enter": [*SHARED, *PROOF, *RIVALS, "benchmark/comparators/entered_tools"],
    "grade": [*SHARED, *ROBOTS, *DRAWING, *CATALOGUE, "benchmark/challenge", "benchmark/grading/answers"],
    "score": [*SHARED, *FORCED, *ROBOTS, *of("benchmark", "seal site_equivalence")]
    + of("benchmark/grading", "answers oracle score"),
    "measures": ["__init__", *TABLES, *of("benchmark/grading", "case_table claim claim_costs claim_lines strata")],
    "pictures": ["__init__", "report/plotting/style"]
    + of("benchmark/grading", "case_table claim claim_costs claim_lines confusion pictures"),
    "examples": [*MODEL[:3], *of("paper/mjx", "engine runtime sensors"), *PICTURES]
    + of("paper/figures", "examples replay"),
    "diagnose_recording": [*READ, *FINDING, *DESIGNING, *EXPORT, *TABLES, *PICTURES]
    + of("report", "contents experiment_picture figures film look numbers page poses")
    + ["effects/fields", "effects/plugins", "diagnosis/track_record", "api/commands/diagnose_recording"],
    "compare_recording": [*READ, *PROOF, *RIVALS, *TABLES, "benchmark/comparators/compare_recording"],
    "recordings_summary": ["__init__", *TABLES, "benchmark/comparators/rig_summary"],
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
    return code("conceal") + [f"src/fimpact/benchmark/rigs/{rig}.xml" for rig in BENCHMARK["rigs"]]


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
