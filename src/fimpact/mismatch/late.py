"""Late: what a simulated window reads of what came before it and of what comes after, by sensors that lag or lead."""

from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from fimpact.effects.base import KINEMATICS, Signal
from fimpact.mismatch.acting import Acting
from fimpact.mismatch.past import Step, backward, continued, reach
from fimpact.mismatch.touch import LOOSE, can_bump
from fimpact.mismatch.windows import Windows

if TYPE_CHECKING:
    from fimpact.mismatch.simulate import Simulator


class Late:
    """The surroundings of windows that `simulator` simulates."""

    def __init__(self, simulator: "Simulator"):
        self.simulator = simulator
        self._known: tuple = (None, None, None)

    def reach(self, hypothesis, windows: Windows) -> tuple[int, int]:
        """Samples before and after `windows` on which readings in them depend."""
        read, period = [p for p in hypothesis.placed if p.effect.when], self.simulator.recording.period
        if not read:
            return 0, 0
        before, after = reach(read, self.simulator.commands.signal(windows, windows.length, period), windows, period)
        return 0 if self.simulator.base.na else before, after  # what actuators have stored at a start is a guess

    def extended(
        self, windows: Windows, measured: np.ndarray, past, before: int, after: int, every: int
    ) -> tuple[np.ndarray, Signal]:
        """Readings from `before` samples before to `after` samples after the windows, every so many steps, and their
        signal.

        Args:
            measured: from the windows' starts on. past: what `past` found; None: nothing was asked.
        """
        substeps, period = self.simulator.substeps, self.simulator.recording.period
        pieces = substeps // every
        inside = measured.shape[1] - after * pieces
        ahead = np.arange(after * pieces) < windows.left[:, None] * pieces
        ends = measured[:, inside - 2 : inside][:, ::-1]
        parts = [measured[:, :inside], continued(ends, measured[:, inside:], ahead * 1.0)]
        if past:
            sensed, share = (part[:, every - 1 : before * substeps : every] for part in past)
            parts.insert(0, continued(measured[:, :2], sensed, share)[:, ::-1])
        measured = np.concatenate(parts, 1)
        earlier = replace(windows, first=windows.first - before)
        signal = self.simulator.commands.signal(earlier, measured.shape[1], period / pieces)
        return measured, replace(signal, since=windows.first[:, None] * period)

    def past(self, hypothesis, windows: Windows, qpos, qvel, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Channels in each of n steps before the windows, nearest first, (w, n, ny), in `samples` or more, and how far
        that is to be believed, (w, n); those of the last call where it was the same motion."""
        simulator = self.simulator
        key, steps = motion_key(hypothesis, windows, qpos, qvel), samples * simulator.substeps
        if self._known[0] == key and self._known[1] is windows.ctrl and self._known[2][1].shape[1] >= steps:
            return self._known[2]
        rows = np.flatnonzero(windows.first > 0)
        sensed, share = np.zeros((len(qpos), steps, len(simulator.columns))), np.zeros((len(qpos), steps))
        step, checked = self._stepper(hypothesis, windows.part(rows), samples)
        states = np.concatenate([qpos, qvel], 1)[rows]
        sensed[rows], share[rows] = backward(simulator.base, step, states, steps, checked)
        share *= np.arange(steps) < windows.first[:, None] * simulator.substeps
        self._known = key, windows.ctrl, (sensed, share)
        return self._known[2]

    def _stepper(self, hypothesis, windows: Windows, samples: int) -> tuple[Step, bool]:
        """A single step of all windows, as `backward` takes it, in the `samples` before them, and whether it must check
        what it found. A law sees the middle of the step, and remembers what it does at the start of a window."""
        simulator = self.simulator
        model, copies, laws = simulator.acted(hypothesis, len(windows.first))
        earlier, n = replace(windows, first=windows.first - samples), samples * simulator.substeps
        signal = simulator.commands.signal(earlier, n)
        ctrl, instant = simulator.commands.given(hypothesis.placed, earlier, signal)
        models, acting = copies or [model] * len(ctrl), Acting(model, copies, laws)
        flags, none = model.opt.disableflags, np.zeros((len(ctrl), model.nv))
        room = {KINEMATICS: mujoco.MjData(model)} if laws else {}
        fresh, zero = windows.memory | room, np.zeros((len(ctrl), 1))

        def step(k: int, state, end, loose: bool) -> tuple[np.ndarray, np.ndarray]:
            for own in copies or [model]:
                own.opt.disableflags = flags | (LOOSE if loose else 0)
            at, memory = n - 1 - k, dict(fresh)
            now, ahead = (np.concatenate([zero, own], 1) for own in (state, (state + end) / 2))
            seen = [simulator.seen(model, own, ctrl[:, at], signal.time[:, at], memory) for own in (now, ahead)]
            told = ctrl[:, at], None if instant is None else instant[:, at], none
            after, sensed = np.empty((len(now), 1, now.shape[1])), np.empty((len(now), 1, model.nsensordata))
            simulator.advance(models, acting, now, seen, told, at % simulator.substeps == 0, after, sensed)
            for own in copies or [model]:
                own.opt.disableflags = flags
            return after[:, 0, 1:], sensed[:, 0, simulator.columns]

        return step, can_bump(model)


def motion_key(hypothesis, windows: Windows, qpos, qvel) -> tuple:
    """What tells one motion of windows from another, how it is measured left out."""
    moving = [(p.name, sorted(p.values.items())) for p in hypothesis.placed if p.effect.enters != "measurement"]
    begun = windows.memory.values()
    states = [part.tobytes() for part in (windows.runs, windows.first, qpos, qvel, *begun)]
    return hypothesis.theta.tobytes(), repr(moving), *states
