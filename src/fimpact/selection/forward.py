"""Forward selection with refits: choose, refit with the trajectory, drop what is worth nothing, and look again."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from fimpact.deciding import BUDGET, MOSTLY, NOTHING, P_ALARM, REFINES, RIVALS, SHARE, UNLIKELY
from fimpact.effects.base import Effect, Placed
from fimpact.effects.wiring import has_servos
from fimpact.selection.one_round import Round, Trial, search
from fimpact.selection.options import Option, options, with_parts
from fimpact.selection.pruning import pruned
from fimpact.selection.refit_start import begun, held_by, is_sum, with_held
from fimpact.selection.regression import Regression
from fimpact.selection.rivals import among_rivals, exchanged, weighed
from fimpact.selection.scanned import scanned
from fimpact.selection.search_scope import Limits
from fimpact.selection.servo_drives import refitted_whole
from fimpact.selection.soft_gears import fitted
from fimpact.selection.substitutes import Alternative, Exchange
from fimpact.smoothing.candidates import Candidate, candidates
from fimpact.smoothing.columns import columns, motion_scales, units
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.parameters import placed_of, theta_of
from fimpact.smoothing.simulated_laws import Simulated
from fimpact.smoothing.smoother import RUNS_AWAY, Smoothed, smooth
from fimpact.smoothing.states import States
from fimpact.smoothing.time_step import settled


class Search:
    """The state of a search: what is in, and what may still come."""

    limits = Limits()

    def __init__(
        self, track: Track, begun: States, noise: np.ndarray, effects: Sequence[Effect], progress: Callable,
        naive: Smoothed | None = None,
    ):  # fmt: skip
        self.track, self.begun, self.noise, self.effects, self.progress = track, begun, noise, effects, progress
        self.begins_at(naive or smooth(track, begun, noise, progress=progress))
        self.rounds: list[Round] = []
        self.alternatives: list[Alternative] = []
        self.dropped, self.failed = set[str](), set[str]()
        self.parts: set[str] = set()  # of whole drives
        self.slight, self.weak = set[str](), set[str]()  # small refinements; what is worth nothing beside what is in
        self.misses = self.tries = 0
        self.softened: set[tuple[str, frozenset[str]]] = set()  # joints whose gears were refitted, with what
        self.unfitted: list[tuple[Trial, tuple[Placed, ...]]] = []  # qualified, and no fit with it has settled
        self.coupled = self.naive.linear.response.long or has_servos(track.model)
        self._simulated = Simulated()
        self.hint = 1.0  # chance of the strongest hint of the first round

    def begins_at(self, naive: Smoothed) -> None:
        """Take `naive` for the fit of the naive model: what may be missing beside it is asked from there."""
        if not np.isfinite(naive.chi2) or not np.isfinite(naive.tau).all():
            raise ValueError(RUNS_AWAY)
        self.naive = self.current = naive
        self.scales = motion_scales(naive)
        self.listed = candidates(self.effects, self.track, self.scales)
        self.candidates = [*self.listed, *scanned(naive, self.listed)]
        self.missing = naive.tau**2  # (N, nv)
        self.first: tuple[Regression, Round] | None = None
        self.asked: Regression | None = None
        self._settled: Smoothed | None = naive

    @property
    def spent(self) -> float:
        """Simulations of all samples in fits so far."""
        return self.track.quanta

    def asks(self) -> bool:
        """Whether one more question may be asked."""
        self.stopped = self.limits.over
        return self.spent < BUDGET and not self.stopped

    def open(self, sums: bool = False) -> list[Candidate]:
        """Candidates that are not in; sums: those that hold what is in, and are no more than it and something more."""
        names = {p.name for p in self.current.placed} | self.dropped | self.weak
        return [c for c in self.candidates if c.name not in names and is_sum(c, self.current.placed) == sums]

    def held_back(self) -> list[Candidate]:
        """Parts of whole drives that were left out beside what is in."""
        return [c for c in self.candidates if c.name in self.weak & self.parts]

    def _refines(self, candidate: Candidate) -> bool:
        refines, model = candidate.effect.refines, self.track.model
        places = {p.site for p in self.current.placed if p.effect.name in refines}
        return bool(places) and (candidate.site in places or not places & set(candidate.effect.sites(model, ())))

    def is_second_gear(self, tried: Sequence[Candidate], option: Option, out: Collection[int] = ()) -> bool:
        """Whether an option of `tried` puts a gear that gives where another does, but for the effects number `out`."""
        held = {p.site for i, p in enumerate(self.current.placed) if p.effect.enters == "gear" and i not in out}
        return any(tried[i].effect.enters == "gear" and tried[i].site in held for i in option.members)

    def searched(self, tried: list[Candidate]) -> tuple[Regression, Round]:
        """Columns of what is tried beside what is in, and the best of them; what is worth most is simulated truly."""
        steps = self.track.steps
        offered = self._without_second_gears(tried)
        while True:
            regression = Regression(self.current, columns(self.current, tried, self._simulated))
            found = search(regression, offered, self.whole(self.current, SHARE), SHARE)
            most = max((t.gain for t in found.tried), default=0.0)
            best = [t for t in found.tried if t.p < P_ALARM and 2 * t.gain >= most]
            if not self._simulated.renew(units([tried[i] for t in best for i in t.option.members])):
                self.track.steps = steps  # one pass a round, however many places there are
                return regression, found

    def beside(self) -> Regression:
        """Columns of all that may be asked beside what is in."""
        if self.asked is not None and self.asked.smoothed is self.current:
            return self.asked
        steps = self.track.steps
        found = Regression(self.current, columns(self.current, self.open(), self._simulated))
        self.track.steps = steps
        return found

    def offered(self, tried: Sequence[Candidate]) -> list[Option]:
        """Options of what is tried, without those that failed or are not to be asked; what is held back comes last
        there, and only with another, and then what is only exchanged."""
        model, held = self.track.model, [i for i, c in enumerate(tried) if c.name in self.weak]
        last = {c.name for c in self.open(sums=True)} | self.weak
        found = options(model, self.track.recording.channels, [c for c in tried if c.name not in last])
        found = self.limits.options(found)
        found += with_parts(model, found, tried, held)
        return [option for option in found if option.name not in self.failed]

    def _without_second_gears(self, tried: Sequence[Candidate]) -> list[Option]:
        return [option for option in self.offered(tried) if not self.is_second_gear(tried, option)]

    def round(self) -> bool:
        """Choose and refit; False where nothing qualifies.

        First what takes a share of all that was missing; then what takes one of what is left beside it, where that is
        little; then what may stand in the place of something else.
        """
        self._settle()
        regression, found = self._asked_anew()
        if found.chosen is not None:
            return self.adopt(regression, found, SHARE)
        if self.current.placed and not self.limits.quick:
            offered = self._without_second_gears(regression.columns.candidates)
            later = search(regression, offered, self.whole(self.current, REFINES), REFINES)
            if later.chosen is not None:
                return self.adopt(regression, later, REFINES)
        first = self.tries == 1 and not self.rounds
        self.rounds += [found] if first else []
        if first and not self.current.placed:
            return weighed(self, regression, found)
        return exchanged(self, regression, self.offered(self.open()))

    def _settle(self) -> None:
        """See that the time step is fine enough: the less is missing, the more of its error shows."""
        if self.current is self._settled:
            return
        own = self.current
        if own.levels.rests.any():  # what rests was told at speeds as they were known before
            again = smooth(self.track, self.begun, self.noise, own.placed, own.priors, own, progress=self.progress)
            self.current = again if again.converged else own
        fit = settled(self.current, self.begun, self.noise, self.progress)
        if fit is not self.current and fit.converged:
            self.current, self.track, self._simulated = fit, fit.track, Simulated()
        self.candidates = [*self.listed, *scanned(self.current, self.listed)]
        self._settled = self.current

    def _asked_anew(self) -> tuple[Regression, Round]:
        if self.first and self.first[0].smoothed is self.current:
            regression, found = self.first
        else:
            regression, found = self.searched([*self.open(), *self.held_back(), *self.open(sums=True)])
        self.first, self.asked = None, regression
        if not self.tries:
            self.hint = min((t.p for t in found.tried), default=1.0) if not self.rounds else self.hint
        self.tries += 1
        done = f"{self.spent:.0f} of at most {BUDGET:.0f} simulations done"
        self.progress(f"selecting: {len(found.tried)} options tried; {done}")
        return regression, found

    def adopt(self, regression: Regression, found: Round, floor: float) -> bool:
        """Refit with what a round chose; False where too many refits in a row have not converged.

        Args:
            floor: the share of `whole` that each effect must bear.
        """
        assert found.chosen is not None
        chosen, others, known = found.chosen, self.alternatives, {p.name for p in self.current.placed}
        missing, left = self.whole(self.current, floor), self.current.missing
        small = floor == REFINES and chosen.share * missing[chosen.place] < MOSTLY * left[chosen.place]
        small = small and all(self._refines(regression.columns.candidates[i]) for i in chosen.option.members)
        steps = self.track.steps
        self.alternatives = []
        self.progress(f"selecting: {chosen.option.name}, {chosen.share:.0%} of the force missing at one place")
        best = refitted_whole(self, regression, chosen)
        best = best if small else among_rivals(self, regression, found, best)
        if chosen.option.compound:
            self.track.steps = steps  # no other question goes unasked because this one came first
            self.parts |= {law.name for law in best.placed} - known
        weak, self.weak, spread = self.weak, set(), regression.dispersion
        best = pruned(self, best, floor)
        self.failed.add(chosen.option.name)
        if not best.converged or best.loss(spread) > self.current.loss(spread):
            self.alternatives, self.misses, self.weak = others, self.misses + 1, weak
            if not best.converged:  # what comes to nothing keeps no other question from being asked
                self.track.steps = steps
                self.unfitted.append((chosen, begun(regression, chosen)[0]))
            return self.misses < RIVALS
        self.current, self.misses = best, 0
        if not {p.name for p in best.placed} & {*chosen.places}:  # beside the rival that came it may come yet
            self.failed.remove(chosen.option.name)
        self.rounds.append(found)
        added = tuple(p for p in best.placed if p.name not in known)
        if small and known <= {p.name for p in best.placed}:  # else it stands in the place of what was in
            self.slight |= {p.name for p in added}
        others = [a for a in others if not {p.name for p in a.placed} & {p.name for p in added}]  # that is the answer
        self.alternatives += [replace(a, placed=(*a.placed, *added)) for a in others]
        return True

    def whole(self, fit: Smoothed, floor: float, beside: Smoothed | None = None) -> np.ndarray:
        """Squared force, (contact modes of `fit`, nv), of which the share `floor` is asked for: all that was missing at
        first, or of a refinement what is left beside a fit, default: what is in, but no less than what would not have
        been worth a name at first."""
        # Where next to nothing is missing of the force of the motion, it is no news that little takes a share of it.
        least = fit.levels.summed(np.ones_like(self.missing) * (NOTHING * self.scales.force) ** 2)
        every = np.maximum(fit.levels.summed(self.missing), least)
        if floor != REFINES:
            return every
        return np.maximum(fit.levels.summed((beside or self.current).tau ** 2), SHARE * every)

    def refitted(self, regression: Regression, trial: Trial | Exchange, out: Collection[int] = ()) -> Smoothed:
        """The fit with the members of `trial`, begun where the regression has them, without the effects `out`."""
        own, known, theta = self.begun_with(regression, trial, out)
        bar = self.current.loss() - np.log(UNLIKELY) * bool(out)  # what takes another's place may be as likely
        return fitted(self, own, known, theta, bar)

    def begun_with(
        self, regression: Regression, trial: Trial | Exchange, out: Collection[int] = ()
    ) -> tuple[tuple[Placed, ...], tuple, np.ndarray]:
        """What is in and the members of `trial` as the regression has them, their priors, and the unknowns, (p,)."""
        placed, priors = begun(regression, trial)
        held = [law for i, law in enumerate(self.current.placed) if i not in out]
        gone = {*out} | {i for law in placed for i in held_by(law.effect, law.site, self.current.placed)}
        placed = tuple(with_held(law, held) for law in placed)
        kept = [i for i in range(len(self.current.placed)) if i not in gone]
        steps = dict(zip(trial.estimate.kept, trial.estimate.values, strict=True))
        numbers = [n.moved(steps.get(i, 0.0)) for i, n in enumerate(self.current.numbers)]
        before, theta = placed_of(numbers, self.current.placed), theta_of(numbers)
        own = (*(before[i] for i in kept), *placed)
        known = (*(self.current.priors[i] for i in kept), *priors)
        return own, known, theta
