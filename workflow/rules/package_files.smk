# The package files each stage depends on: editing one reruns the stages that list it. tests/test_workflow.py
# compares the lists with what the modules import.


def of(package, modules):
    """Package files of `modules`, names in one text, of one package."""
    return [f"{package}/{name}" for name in modules.split()]


MODEL = ["__init__", "paper/systems/__init__", "paper/systems/base"]
MODEL += of("paper/mjx", "engine runtime sensors") + of("paper/information", "fisher programs rollout traced")
FORECAST = ["support/mujoco_setup", "paper/forecast"]
PLANNING = of("paper/contact_implicit", "bodies plan simulate step transcription")
TABLES = ["support/tables", "support/atomic_files"]
TRIAL = [*MODEL, *FORECAST, *PLANNING, *TABLES]
TRIAL += of("paper", "reference_simulator design search estimate task trial")
FAMILIES = "actuation contact environment friction masses sensing servos structure transmission"
CATALOGUE = of("effects", "__init__ base drives gears law_inputs mounts native priors sites touching typical wiring")
CATALOGUE += of("effects/families", FAMILIES)
SHARED = ["__init__", *TABLES, "recordings", *of("benchmark", "archive jsonl")]
ROBOTS = ["support/mujoco_setup", "benchmark/truth", *of("benchmark/rigs", "planar registry rig robots")]
ROBOTS += of(
    "benchmark/planting",
    "bodies contacts crowd gears ground_truth joints out_of_catalogue plant planted_effects servos signals",
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
    "added_forces compiled horizon hypothesis inputs model_pool nonsmooth rotors servo_steps simulator state_guess window_fit windows",
)
PROOF += of("smoothing", "noise_levels parameters prepare rounds servo_lag smoother states step stretches time_step")
PROOF += of(
    "smoothing/dynamics",
    "body_inertia clock dry_friction gear_laws inverse laws linear plain_motors plant response rotor_states sampled_commands side_by_side softness track",
)
PROOF += of("smoothing/filter", "by_run kalman")
FINDING = [*PROOF, *of("smoothing", "candidates columns simulated_laws"), "effects/classes"]
FINDING += of(
    "selection",
    "carried_bodies chance explanation forward one_round options pruning refit_start regression rivals scanned search_scope servo_drives soft_gears substitutes swaying_bases unnamed_rest",
)
FINDING += of(
    "diagnosis/identifiability",
    "advice blind_spots judging motion_model proposed_motions quick_look sentences suspects",
)
FINDING += of("diagnosis", "blind_record notes pipeline remainder") + of("diagnosis/wording", "certainty verdict")
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


def code(stage, system=None):
    """Package files that `stage` depends on, with those of `system` if it simulates one."""
    own = [f"paper/systems/{system}.py", f"paper/systems/{system}.xml"] if system else []
    return [f"src/fimpact/{name}" for name in [f"{module}.py" for module in STAGES[stage]] + own]


def simulation(stage):
    """Input function: package files of a stage that simulates the system in the wildcards."""
    return lambda wildcards: code(stage, wildcards.system)


def planting():
    """Package files, and MJCF of the rigs, on which the robots depend."""
    return code("conceal") + [f"src/fimpact/benchmark/rigs/{rig}.xml" for rig in BENCHMARK["rigs"]]


def diagnosing():
    """Package files on which a page depends."""
    return code("diagnose_recording") + ["src/fimpact/cases/schema.yaml", "src/fimpact/report/page.html.jinja"]
