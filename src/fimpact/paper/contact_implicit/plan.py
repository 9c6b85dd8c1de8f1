"""An experiment by direct transcription: IPOPT, from a relaxed contact that is felt from afar to a rigid one.

Every stage starts from the motion that its own eps gives the design found so far, so that it starts feasible. IPOPT
runs in short bursts: after each, the motion of the design found is simulated, and the next burst starts from there;
nearby, if that one gained nothing. Left alone, it spends most of its iterations on the way back from motions that
cannot be made.
"""

import json
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from fimpact.paper.contact_implicit.bodies import PLANAR
from fimpact.paper.contact_implicit.simulate import Motion, Simulator
from fimpact.paper.contact_implicit.step import Step, step
from fimpact.paper.contact_implicit.transcription import Affine, Transcription
from fimpact.paper.systems.base import System

SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
BURST = 12  # iterations between two simulations; ten or so are well spent before steps get short
LEAST = 1e-2  # gain in the logarithm of information below which the next burst keeps nearer to where it starts
FAR, NEARER, NEAREST = 2.0, 0.1, 1e-3  # how far a burst may go in the inputs, whose range is 2 here
CLOSING = 3  # times the iterations of other stages are the last one's, which is to converge
LOST = 1 / 30  # share of information below which a stage has lost the contact of the one before; most stages gain
IPOPT = {
    "linear_solver": "mumps",  # in CasADi's wheel, and the same bytes every time
    "mumps_pivot_order": 5,  # METIS: a third of the time that MUMPS's own choice takes
    "mumps_mem_percent": 100,  # ten times as much is zeroed by default for every factorisation, and never used
    "nlp_scaling_method": "none",  # by hand, in transcription
    "tol": 1e-2,  # of the logarithm of information
    "constr_viol_tol": 1e-6,
    # Good enough too: three iterations in a row that change information by less than a thousandth of its logarithm and
    # fulfil the equations to 0.01 N or so. The information of contact has long flat ridges, and what is found is
    # simulated exactly.
    "acceptable_tol": 0.1,
    "acceptable_constr_viol_tol": 1e-2,
    "acceptable_obj_change_tol": 1e-3,
    "acceptable_iter": 3,
    "mu_init": 1e-2,
    "constr_mult_init_max": 1e10,  # multipliers of forces are large, and a start without them is far from optimal
    "theta_max_fact": 10.0,  # stays near motions that can be made: far from them lie false optima, and no way back
    "bound_push": 1e-6,  # a knot that was at its limit stays there
    "bound_frac": 1e-6,
    "print_level": 0,
    "sb": "yes",
}


@dataclass(frozen=True)
class Plan:
    """What one solution says, and how it was found.

    Attributes:
        rho: the robot it is for, (p,), in relative parameters.
        design: inputs (d,).
        designs: those after all bursts of all stages, of which `design` is the last, (k, d).
        after: states, forces and slacks after every step of `length` s, (N, nx + nf).
        reading: what each step measures, (N, ny), in the sensor's unit.
        information: trace of the planned Fisher information, in the units of rho that were given.
        residual: greatest complementarity product, N m or N m/s.
        solved: whether IPOPT converged in the last stage, to its own or to an acceptable tolerance, and its motion can
            be made. If bursts over the whole range did not, the optimum is one among designs nearby.
        statuses: what it said of every stage.
        iterations: its iterations, all stages together.
    """

    rho: np.ndarray
    design: np.ndarray
    designs: np.ndarray
    after: np.ndarray
    reading: np.ndarray
    length: float
    information: float
    residual: float
    solved: bool
    statuses: tuple[str, ...]
    iterations: int


class Planner:
    """The programme of one system, compiled once; the parameters of the robot and eps are arguments of it."""

    def __init__(self, system: System, intervals: int):
        self.system, every = system, max(1, round(system.steps / intervals))
        self.length, count = system.settings["timestep"] * every, system.steps // every
        low, high = system.inputs.bounds
        self.affine = affine(system, every, count)
        planar = PLANAR[system.name](system)
        self.step: Step = step(system, planar, self.length, self.affine.controls.shape[1])
        self.simulator = Simulator(self.step)
        self.programme = Transcription(self.step, self.affine, (low + high) / 2, (high - low) / 2, count)
        self._solvers: dict[int, ca.Function] = {}

    def plan(
        self, rho: np.ndarray, start: np.ndarray, eps: list[float], iterations: int, units: np.ndarray | None = None
    ) -> Plan:
        """Maximise the trace of information at `rho` (p,), from the design `start` (d,), down the schedule `eps`.

        Where the next eps would lose the contact that was found, a stage half-way (of the logarithm) comes first.

        Args:
            iterations: of IPOPT, at most, in each stage but the last, which may take three times as many to converge.
            units: in which rho is counted, (p, p), by columns; relative ones if not given.
        """
        units = np.eye(len(rho)) if units is None else units
        design, motion, last, designs, statuses, spent = start, None, np.inf, [], [], 0
        for target in eps:
            ahead = self.simulate(design, rho, target, units)
            halfway = motion is not None and ahead.information < LOST * motion.information
            for stage in (np.sqrt(last * target), target) if halfway else (target,):
                begun = self.simulate(design, rho, stage, units) if halfway else ahead
                most = iterations * (CLOSING if stage == eps[-1] else 1)
                design, motion, tried, told = self.stage(design, begun, rho, stage, most, units)
                designs += tried
                statuses.append(told["return_status"])
                spent += told["iter_count"]
            last = target
        if motion is None:
            raise ValueError("the schedule eps is empty; give at least one value above 0, such as [0.1, 1e-3, 1e-6]")
        products = self.products(design, motion.after, rho)
        return Plan(
            rho=rho,
            design=design,
            designs=np.array(designs),
            after=motion.after,
            reading=motion.reading * self.system.sensor.noise,
            length=self.length,
            information=motion.information,
            residual=float(np.abs(products).max()),
            solved=statuses[-1] in SOLVED and motion.solved,
            statuses=tuple(statuses),
            iterations=spent,
        )

    def stage(self, design, motion, rho, eps, most, units) -> tuple[np.ndarray, Motion, list[np.ndarray], dict]:
        """Solve one stage: its design and motion, from those given; the designs after each burst; IPOPT's statistics.

        Motions are simulated, so that their equations hold whatever IPOPT left of them; a design that then gathers less
        than the one before is not taken. Rigid contact has information in small smooth pieces, and a burst that leaves
        its piece gains nothing: the next one keeps nearer to the design. The stage ends when IPOPT has converged, after
        `most` of its iterations, or when nothing is gained nearby either.
        """
        settings, tried, spent, reach = np.concatenate([rho, [eps], units.ravel("F")]), [], 0, FAR
        while True:
            started, burst = self.programme.pack(design, motion), min(BURST, most - spent)
            variables, told = self.solve(started, settings, burst, reach)
            spent += told["iter_count"]
            found, before = self.programme.design(variables), motion.information
            made = self.simulate(found, rho, eps, units)
            if made.information >= before:
                design, motion = found, made
            tried.append(design)
            gain = np.log1p(max(motion.information, 0)) - np.log1p(max(before, 0))
            reach *= NEARER if gain < LEAST else 1
            if told["return_status"] in SOLVED or spent >= most or reach < NEAREST:
                return design, motion, tried, {**told, "iter_count": spent}

    def simulate(self, design: np.ndarray, rho: np.ndarray, eps: float, units: np.ndarray | None = None) -> Motion:
        """The relaxed motion of `design`, with sensitivities in `units` of rho, relative ones if not given."""
        start, controls = self._launch(design)
        return self.simulator.run(start, controls, rho, eps, np.eye(len(rho)) if units is None else units)

    def _launch(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a = self.affine
        return a.start + a.start_slope @ design, a.controls + a.controls_slope @ design

    def solve(self, start: np.ndarray, settings: np.ndarray, iterations: int, reach: float) -> tuple[np.ndarray, dict]:
        """Solve one burst: the variables, at most `reach` from the design they start with, and IPOPT's statistics."""
        programme, solver = self.programme, self._solver(iterations)
        low, high = np.full(programme.size, -np.inf), np.full(programme.size, np.inf)
        inputs = start[: programme.designs]
        low[: programme.designs] = np.maximum(inputs - reach, -1)
        high[: programme.designs] = np.minimum(inputs + reach, 1)
        low[programme.designs] = 0
        found = solver(x0=start, p=settings, lbx=low, ubx=high, lbg=0, ubg=0)
        return np.array(found["x"])[:, 0], solver.stats()

    def _solver(self, iterations: int) -> ca.Function:
        if iterations not in self._solvers:
            options: dict[str, Any] = {
                f"ipopt.{name}": value for name, value in {**IPOPT, "max_iter": iterations}.items()
            }
            options |= {"print_time": False, **self.programme.options}
            self._solvers[iterations] = ca.nlpsol("plan", "ipopt", self.programme.problem, options)
        return self._solvers[iterations]

    def products(self, design: np.ndarray, after: np.ndarray, rho: np.ndarray) -> np.ndarray:
        """Complementarity products of every step, (N, 4 nc), N m or N m/s."""
        before = np.vstack([self._launch(design)[0], after[:-1, : self.step.states]])
        each = after.T, before.T, np.tile(rho, (len(after), 1)).T
        return np.array(self.step.products.map(len(after))(*each)).T


_SHARED: dict[str, Planner] = {}


def planner(system: System, intervals: int) -> Planner:
    """The planner of `system`, built once per process.

    Raises:
        ValueError: the system has no rigid-body terms.
    """
    if system.name not in PLANAR:
        raise ValueError(
            f"contact_implicit has no rigid-body terms of system '{system.name}', only of {', '.join(PLANAR)}; "
            "write them in fimpact/paper/contact_implicit/bodies.py, or leave contact_implicit out of select.methods"
        )
    key = f"{system.name} {intervals} {json.dumps(system.settings)}"
    if key not in _SHARED:
        _SHARED[key] = Planner(system, intervals)
    return _SHARED[key]


def affine(system: System, every: int, count: int) -> Affine:
    """What `system.launch` makes of a design, in `count` steps of `every` of the simulation's: means of controls."""

    def launched(design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        qpos, qvel, ctrl = system.launch(system, design)
        ctrl = np.asarray(ctrl)[: count * every]
        return np.concatenate([qpos, qvel]), ctrl.reshape(count, every, ctrl.shape[1]).mean(1)

    size = len(system.inputs.bounds[0])
    start, controls = launched(np.zeros(size))
    each = [launched(row) for row in np.eye(size)]
    start_slope = np.stack([moved - start for moved, _ in each], -1)
    return Affine(start, start_slope, controls, np.stack([pushed - controls for _, pushed in each], -1))
