"""What contact_implicit plans from a start without contact, and how its forces compare with MuJoCo's.

The plan believes in rigid contact, MuJoCo's is soft. The same inputs are played on the robot of the plan, so that
nothing but the contact differs: that is what softness costs.
"""

from collections.abc import Callable

import mujoco
import numpy as np
import pandas as pd

from fimpact.paper import reference_simulator
from fimpact.paper.contact_implicit.plan import Plan, planner
from fimpact.paper.design import transcribe
from fimpact.paper.information.fisher import fisher
from fimpact.paper.information.programs import programs
from fimpact.paper.reach import contact_free, first_task
from fimpact.paper.systems import System, make_system
from fimpact.paper.systems.base import total_contact_force
from fimpact.paper.task import Task
from fimpact.paper.trial import draw_truth, stream

COLUMNS = (
    "system seed start_contact_steps planned_contact_steps contact_steps_at_plan contact_steps solved residual "
    "iterations information_planned information_played correlation rms impulse_ratio"
).split()
FORCES = "system seed time axis planned simulated".split()
AXES = ("normal", "tangential")
TOUCH = 0.1  # N; above what relaxed contact exerts from afar


def run_plans(config: dict, system: str, progress: Callable[[str], None]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A plan for every seed of `reach.planned`, from one design that stays clear: a row each, and the forces over time.

    `contact_steps_at_plan` counts steps in contact when MuJoCo plays the design on the robot it was planned for,
    `contact_steps` on the seed's truth. Forces are means over the plan's steps, in N: `correlation` and `rms` (of the
    difference) are over normal and tangential forces together, `impulse_ratio` is MuJoCo's normal impulse over the
    planned. Information is the trace at the plan's robot: as planned, and through MJX's soft contact.
    """
    made, rows, forces = make_system(system, config["systems"][system]), [], []
    for seed in config["reach"]["planned"]:
        row, drawn = _plan(config, made, seed)
        rows.append(row)
        forces.append(drawn)
        progress(f"{system} plans: {len(rows)} of {len(config['reach']['planned'])} seeds")
    return pd.DataFrame(rows, columns=COLUMNS), pd.concat(forces)


def _plan(config: dict, system: System, seed: int) -> tuple[tuple, pd.DataFrame]:
    rho, guess = draw_truth(system, seed)
    task = first_task(config, system, guess, stream(system, seed, "plans"))
    start = contact_free(task, np.vstack([task.beliefs, guess, rho]), 1)[0]
    plan = transcribe(task, start)
    planned, simulated = forces(task, plan)

    def steps(relative: np.ndarray, design: np.ndarray) -> int:
        return reference_simulator.simulate(system, relative * system.nominal, design)[1]

    before = steps(rho, start) + steps(guess, start)
    touched = int((planned[:, 0] > TOUCH).sum())
    found = (before, touched, steps(plan.rho, plan.design), steps(rho, plan.design))
    told = (int(plan.solved), plan.residual, plan.iterations, plan.information, _played(task, plan))
    row = (system.name, seed, *found, *told, *compare(planned, simulated))
    return row, _table(system, seed, plan, planned, simulated)


def _played(task: Task, plan: Plan) -> float:
    slope = programs(task.system).linearise(task.system.template, plan.rho, plan.design).sensitivity[0]
    return float(np.trace(fisher(slope)))


def forces(task: Task, plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Normal and tangential contact force, summed over contacts, as planned and as MuJoCo has them: (N, 2) each, N."""
    step = planner(task.system, task.budget["transcription"]["intervals"]).step
    normal, ahead, back, _ = np.split(plan.after[:, step.states :], 4, axis=1)
    planned = np.stack([normal.sum(1), (ahead - back).sum(1)], 1)
    every = round(plan.length / task.system.settings["timestep"])
    played = simulate(task.system, plan.rho * task.system.nominal, plan.design)[: every * len(planned)]
    return planned, played.reshape(len(planned), every, 2).mean(1)


def simulate(system: System, theta: np.ndarray, design: np.ndarray) -> np.ndarray:
    """MuJoCo's contact force along the surface's normal and along x after every step, (T, 2), N."""
    model = system.compile(theta)
    data = mujoco.MjData(model)
    qpos, qvel, ctrl = system.launch(system, np.asarray(design))
    data.qpos[:], data.qvel[:] = qpos, qvel
    rows = []
    for u in np.asarray(ctrl):
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        force = total_contact_force(model, data)
        normal = data.geom_xmat[model.pair_geom1[0]].reshape(3, 3)[:, 2]
        rows.append((normal @ force, force[0]))
    return np.array(rows)


def compare(planned: np.ndarray, simulated: np.ndarray) -> tuple[float, float, float]:
    """Correlation, root mean square difference (N), and ratio of the normal impulses; NaN where one has no contact."""
    off = float(np.sqrt(((planned - simulated) ** 2).mean()))
    if not (planned[:, 0] > TOUCH).any() or not simulated.any():
        return np.nan, off, np.nan
    alike = float(np.corrcoef(planned.ravel(), simulated.ravel())[0, 1])
    return alike, off, float(simulated[:, 0].sum() / planned[:, 0].sum())


def _table(system: System, seed: int, plan: Plan, planned: np.ndarray, simulated: np.ndarray) -> pd.DataFrame:
    time = (np.arange(len(planned)) + 0.5) * plan.length
    parts = [
        pd.DataFrame(dict(zip(FORCES, (system.name, seed, time, axis, planned[:, i], simulated[:, i]), strict=True)))
        for i, axis in enumerate(AXES)
    ]
    return pd.concat(parts)
