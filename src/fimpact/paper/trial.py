"""One trial = one seed: a hidden truth, a wrong first guess, and rounds of design, run, estimate.

Every method of one seed shares truth, first guess, measurement noise and estimator draws: each has a stream of
random numbers of its own, named by seed and purpose.
"""

import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from fimpact.paper import reference_simulator
from fimpact.paper.design import METHODS
from fimpact.paper.estimate import FAR, Estimate, beliefs, estimate, untried
from fimpact.paper.information.fisher import fisher
from fimpact.paper.information.programs import programs
from fimpact.paper.search import Campaign
from fimpact.paper.systems import System, make_system
from fimpact.paper.task import Design, Task

Z95 = 1.959964  # two-sided 95 % quantile of the normal distribution


@dataclass(frozen=True)
class Trials:
    """Tidy rows per system, method, seed, round and parameter, their diagnostics, and the designs by array name."""

    table: pd.DataFrame
    diagnostics: pd.DataFrame
    designs: dict[str, np.ndarray]


@dataclass
class Ledger:
    """What one trial has produced so far."""

    rows: list[dict] = field(default_factory=list)
    diagnostics: list[dict] = field(default_factory=list)
    designs: list[np.ndarray] = field(default_factory=list)


def stream(system: System, seed: int, purpose: str, round_: int = 0) -> np.random.Generator:
    """Random numbers for one purpose of one seed, the same for every method."""
    return np.random.default_rng([seed, zlib.crc32(f"{system.name} {purpose}".encode()), round_])


def draw_truth(system: System, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """True and guessed relative parameters, (p,) each: the truth is uniform within `spread` of nominal,
    the guess is off by the prior's relative standard deviation, within the bounds."""
    rng, spread = stream(system, seed, "truth"), system.settings["spread"]
    low, high = system.bounds
    rho = rng.uniform(1 - spread, 1 + spread, len(low))
    return rho, np.clip(rho * (1 + system.settings["prior"] * rng.standard_normal(len(low))), low, high)


def run_trials(config: dict, system: str, method: str, seeds: list[int], progress: Callable[[str], None]) -> Trials:
    """All rounds of every seed.

    Args:
        config: the whole configuration; `system` and `method` are names in it.
        progress: receives one line after each seed.
    """
    return _run(config, make_system(system, config["systems"][system]), method, seeds, config["rounds"], progress)


def run_sweep(config: dict, system: str, method: str, surface: float, progress: Callable[[str], None]) -> pd.DataFrame:
    """The trials of one position (m) of the surface, at the sweep's own rounds; rows as `trials.csv` plus `surface`."""
    sweep = config["sweep"]
    moved = make_system(system, {**config["systems"][system], "surface": surface})
    table = _run(config, moved, method, sweep["seeds"], sweep["rounds"], progress).table
    return table.assign(surface=surface)[["surface", *table.columns]]


def _run(config, system: System, method: str, seeds: list[int], rounds: int, progress) -> Trials:
    ledgers, started = [], time.monotonic()
    for done, seed in enumerate(seeds, 1):
        ledgers.append(_run_seed(config, system, method, seed, rounds))
        left = (time.monotonic() - started) / done * (len(seeds) - done)
        progress(f"{system.name} {method}: {done} of {len(seeds)} seeds, {int(left // 60)}:{int(left % 60):02d} left")
    table = pd.DataFrame([row for ledger in ledgers for row in ledger.rows], columns=TABLE)
    diagnostics = pd.DataFrame([row for ledger in ledgers for row in ledger.diagnostics], columns=DIAGNOSTICS)
    truths = [draw_truth(system, seed)[0] * system.nominal for seed in seeds]
    designs = {"seeds": np.array(seeds, int), "truth": np.array(truths)}
    return Trials(table, diagnostics, {**designs, "designs": np.array([ledger.designs for ledger in ledgers])})


def _run_seed(config, system: System, method: str, seed: int, rounds: int) -> Ledger:
    rho, guess = draw_truth(system, seed)
    campaign = Campaign(system, system.template, (), guess, system.settings["prior"])
    belief, ledger = untried(campaign), Ledger()
    _record(ledger, campaign, method, seed, rho, belief, Design(np.zeros(0), np.nan, 0), 0.0)
    for round_ in range(rounds):
        started = time.monotonic()
        chosen = design_next(config, campaign, belief, method, seed, round_, rounds)
        noise = stream(system, seed, "noise", round_).standard_normal((system.steps, len(system.sensor.channels)))
        recording = reference_simulator.run(system, rho * system.nominal, chosen.design, noise)
        campaign = replace(campaign, recordings=(*campaign.recordings, recording))
        found = estimate(campaign, config["estimate"], belief.carried, stream(system, seed, "starts", round_))
        belief = found if np.isfinite(found.rho).all() else belief
        ledger.designs.append(chosen.design)
        _record(ledger, campaign, method, seed, rho, found, chosen, time.monotonic() - started)
    return ledger


def design_next(
    config, campaign: Campaign, found: Estimate, method: str, seed: int, round_: int, rounds: int
) -> Design:
    """The design of `method` for what is believed after `found`, given all that was recorded."""
    system, budget = campaign.system, config["design"]
    gained = 0.0 if found.status == FAR else information(campaign, found.rho)
    # Methods that draw blindly are given no budget, and believe nothing.
    rng = stream(system, seed, "beliefs", round_)
    believed = beliefs(campaign, found, budget["draws"], rng) if budget else found.rho[None]
    # A throw follows one multisine from round to round, and draws its phases once.
    rng = stream(system, seed, "design", 0 if method == "multisine" and system.inputs.knots == 1 else round_)
    known = prior_precision(campaign) + gained
    estimate = campaign.guess if found.status == FAR else found.rho
    return METHODS[method](Task(system, believed, known, round_, rounds, budget, rng, estimate))


def prior_precision(campaign: Campaign) -> np.ndarray:
    """Inverse covariance of the prior in relative parameters, (p, p)."""
    return np.eye(len(campaign.guess)) / campaign.prior_sd**2


def information(campaign: Campaign, rho: np.ndarray) -> np.ndarray:
    """Fisher information of all recordings at `rho`, (p, p); zero before the first."""
    if not campaign.recordings:
        return np.zeros((len(rho), len(rho)))
    slopes = programs(campaign.system).linearise(campaign.model, rho, campaign.designs).sensitivity
    return sum(fisher(slope) for slope in slopes)


TABLE = (
    "system method seed round parameter truth estimate relative_error "
    "information_trace information_logdet contact_steps status seconds"
).split()
DIAGNOSTICS = "system method seed round parameter standard_error covered agreement candidates".split()


def _record(ledger: Ledger, campaign, method, seed, rho, found: Estimate, chosen: Design, seconds: float) -> None:
    system, gained = campaign.system, information(campaign, rho)
    logdet = np.linalg.slogdet(prior_precision(campaign) + gained)[1]
    touched = campaign.recordings[-1].contact_steps if campaign.recordings else 0
    error = np.sqrt(np.diag(found.covariance))
    for i, parameter in enumerate(system.parameters):
        key = (system.name, method, seed, len(campaign.recordings), parameter.name)
        value = (rho[i] * parameter.nominal, found.rho[i] * parameter.nominal, found.rho[i] / rho[i] - 1)
        ledger.rows.append(
            dict(zip(TABLE, (*key, *value, np.trace(gained), logdet, touched, found.status, seconds), strict=True))
        )
        covered = int(abs(found.rho[i] - rho[i]) <= Z95 * error[i])
        trust = (error[i] / rho[i], covered, found.agreement, chosen.candidates)
        ledger.diagnostics.append(dict(zip(DIAGNOSTICS, (*key, *trust), strict=True)))
