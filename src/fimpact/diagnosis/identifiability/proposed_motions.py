"""Simple motions that an owner can command, the simplest first, and which of them would show what the recorded do not.

Each joint alone there and back, at one speed, at two, or in a sweep; all joints at once; the same with a known weight.
They keep to speeds that the recordings have, and to the ranges of joints and motors; no experiment is searched for.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np

from fimpact.diagnosis.identifiability.advice import (
    LONGER,
    SLOW,
    Advice,
    Lazy,
    Wave,
    commands_for,
    steady_wave,
    sweeping_wave,
)
from fimpact.diagnosis.identifiability.judging import NEEDED, Judge
from fimpact.diagnosis.identifiability.motion_model import Commands, Motion
from fimpact.diagnosis.identifiability.quick_look import Sight, pace, reach
from fimpact.effects import EFFECTS
from fimpact.effects.sites import driven
from fimpact.effects.touching import NO_CONTACT
from fimpact.effects.wiring import HINGE, SLIDE, drives

SAMPLES = 150  # of a motion
ROOM = 0.8  # of the way to the end of a joint's range


class Advisor:
    """Finds the simplest motion that shows something of `names`."""

    def __init__(self, sight: Sight, names: Sequence[str]):
        self.sight, self.model = sight, sight.motion.model
        asked = {own.name for own in sight.judge.asked}
        self.names = [name for name in names if name in asked]
        self._after: dict[tuple[int, tuple[str, ...]], Judge] = {}

    def shows(self, name: str) -> Advice | None:
        """The first motion after which `name` is seen."""
        return next((one for one in self._offered([name]) if self._seen(one, name)), None)

    def frees(self, names: Sequence[str]) -> Advice | None:
        """The first motion after which what is fitted no longer swallows any of `names`."""

        def clear(judge: Judge) -> bool:
            return all(judge.clear(own) for own in judge.asked if own.name in names)

        return next((one for one in self._offered(names) if clear(self._judge(one, names))), None)

    def parts(self, names: Sequence[str]) -> tuple[Advice, list[tuple[str, ...]]] | None:
        """The first motion that parts `names` into most groups, and these; None where none parts them."""
        best, most = None, 1
        for one in self._offered(names) if set(names) <= set(self.names) else ():
            groups = self._judge(one, names).parted(names)
            if len(groups) > most and sum(map(len, groups)) == len(names):
                best, most = (one, groups), len(groups)
            if most == len(names):
                break
        return best

    def unmasks(self, one: str, others: Sequence[str]) -> Advice | None:
        """The first motion after which none of `others`, at the same joint, passes for `one` any more."""
        tried = (own for own in self._offered([one]) if own.motion is not None)
        return next((own for own in tried if not self._posed(own, one, others)), None)

    def at_one_joint(self, one: str, other: str) -> bool:
        """Whether the same joint moves both."""
        return bool(set(self._near.get(one, ())) & set(self._near.get(other, ())))

    def _posed(self, advice: Advice, one: str, others: Sequence[str]) -> bool:
        judge = self._judge(advice, [one, *others])
        return any(judge.poses(one, other) for other in others)

    def _seen(self, one: Advice, name: str) -> bool:
        # All that a motion may show at once: its columns share what takes longest.
        near = [own for own in self.names if not one.joint or one.joint in self._near[own]]
        judge = self._judge(one, near)
        return any(own.name == name and judge.shows(own) >= NEEDED for own in judge.asked)

    def _judge(self, one: Advice, names: Sequence[str]) -> Judge:
        if one.motion is None:
            return self.sight.judge.longer()
        key = id(one), tuple(names)
        if key not in self._after:
            self._after[key] = self.sight.further(one.motion, names)
        return self._after[key]

    def _offered(self, names: Sequence[str]) -> Iterator[Advice]:
        yield LONGER
        for joint in dict.fromkeys(joint for name in names for joint in self._near.get(name, ())):
            yield from self.alone[joint]
        yield from self.together

    @cached_property
    def _near(self) -> dict[str, list[str]]:
        """Joints that move the place of each name: itself, that of a motor, or the nearest that carries a body."""
        return {name: self._joints(name.partition("@")[2]) for name in self.names}

    def _joints(self, site: str) -> list[str]:
        model, known = self.model, list(self.alone)
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, site)
        if site in known or motor >= 0:
            return [site] if site in known else [joint for joint in known if motor in drives(model, joint)]
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, site)
        while body > 0:
            first = int(model.body_jntadr[body])
            found = [model.joint(first + i).name for i in range(int(model.body_jntnum[body]))]
            if set(found) & set(known):
                return [joint for joint in found if joint in known]
            body = int(model.body_parentid[body])
        return []

    @cached_property
    def alone(self) -> dict[str, Iterable[Advice]]:
        """Motions of each joint that a motor drives, alone."""
        if any(int(kind) not in (HINGE, SLIDE) for kind in self.model.jnt_type):
            return {}
        return {joint: Lazy(self._alone(joint)) for joint in driven(self.model)}

    def _alone(self, joint: str) -> Iterator[Advice]:
        row = self.model.joint(joint)
        slides, fast = row.type[0] == SLIDE, self._speed(joint)
        unit, slow = "m/s" if slides else "rad/s", self._speed(joint) / SLOW
        way = self._way(joint)
        for how, waves in (
            (f"there and back at {slow:.2g} {unit}", (steady_wave(way, slow),)),
            (
                f"there and back, at {slow:.2g} and at {fast:.2g} {unit}",
                (steady_wave(way, slow), steady_wave(way, fast)),
            ),
            (f"to and fro, faster and faster up to {fast:.2g} {unit}", (sweeping_wave(way, fast),)),
        ):
            found = self._played([{joint: wave} for wave in waves])
            if found is not None:
                yield Advice(joint, how, found)

    @cached_property
    def together(self) -> Iterable[Advice]:
        """Motions of all joints at once, and with a weight; where no motor is, from farther away."""
        if not self.model.nu:
            return self._let_go()
        if len(self.alone) < 1:
            return []
        found, names = [], list(self.alone)
        paces = {joint: 0.6 ** (k / max(len(names) - 1, 1)) * self._speed(joint) for k, joint in enumerate(names)}
        moves = [
            {joint: steady_wave(self._way(joint), speed / part) for joint, speed in paces.items()}
            for part in (SLOW, 1.0)
        ]
        how = "move all joints at once, there and back, each at its own rhythm, slowly and fast"
        every = self._played(moves) if len(names) > 1 else None
        found += [Advice("", how, every)] if every is not None else []
        weighted = self._played(moves, self._weight())
        told = f"record once more with a known weight at {self._last()}, of {self._weight():.2g} kg or so"
        return found + ([Advice("", told, weighted)] if weighted is not None else [])

    def _let_go(self) -> list[Advice]:
        """A fall or a swing from farther away than any that was recorded."""
        own, motion, data = copy.copy(self.model), self.sight.motion, mujoco.MjData(self.model)
        if any(int(kind) not in (HINGE, SLIDE) for kind in own.jnt_type):
            return []
        own.opt.timestep = motion.track.period
        rest, away = own.qpos0, np.abs(motion.qpos - own.qpos0).max(0)
        farther = np.where(own.jnt_type == HINGE, np.minimum(2 * away, 0.9 * np.pi), 2 * away)
        data.qpos[:] = rest + farther * np.where(np.median(motion.qpos[:1], 0) < rest, -1.0, 1.0)
        rows, count = [], min(int(motion.track.lengths.max()), 5 * SAMPLES)
        for _ in range(count):
            mujoco.mj_step(own, data)
            rows.append((data.qpos.copy(), data.qvel.copy(), data.qacc.copy()))
        qpos, qvel, qacc = (np.array(part) for part in zip(*rows, strict=True))
        commands = Commands(np.zeros((count, 0)), np.arange(count) * own.opt.timestep, (count,), np.arange(count))
        found = replace(motion, qpos=qpos, qvel=qvel, qacc=qacc, commands=commands, lengths=(count,))
        return [Advice("", "let it go from twice as far away", found)] if np.isfinite(qpos).all() else []

    def _speed(self, joint: str) -> float:
        """The largest speed that the recordings have of a joint of its kind, rad/s or m/s."""
        model, motion = self.model, self.sight.motion
        kind = int(model.joint(joint).type[0])
        alike = (model.jnt_type[model.dof_jntid] == kind) & ~self.sight.still
        fast = np.quantile(np.abs(motion.qvel[:, alike]), 0.99, 0) if alike.any() else np.zeros(1)
        return float(fast.max()) or pace(self.sight.scales, kind)

    def _way(self, joint: str) -> tuple[float, float]:
        """Middle and half of the way of a joint, rad or m."""
        row, kind = self.model.joint(joint), int(self.model.joint(joint).type[0])
        own = self.sight.motion.qpos[:, row.qposadr[0]]
        if not self.model.jnt_limited[row.id]:
            return float(own.mean()), max(float(np.ptp(own)) / 2, reach(self.sight.scales, kind) / 2)
        low, high = row.range
        half = ROOM * min((high - low) / 2, reach(self.sight.scales, kind))
        return float(np.clip(own.mean(), low + half, high - half)), float(half)

    def _played(self, blocks: Sequence[dict[str, Wave]], weight: float = 0.0) -> Motion | None:
        """A motion of some joints while the others rest, one block after the other, under the commands it takes; None
        where it would take more than the motors give."""
        parts = [self._block(block) for block in blocks]
        qpos, qvel, qacc, time = (np.concatenate([part[i] for part in parts]) for i in range(4))
        lengths = tuple(len(part[0]) for part in parts)
        commands = Commands(np.zeros((len(time), self.model.nu)), time, lengths, np.arange(len(time)))
        made = replace(self.sight.motion, qpos=qpos, qvel=qvel, qacc=qacc, commands=commands, lengths=lengths)
        ctrl = commands_for(made, self._loaded(weight) if weight else self.model)
        return None if ctrl is None else replace(made, commands=replace(commands, ctrl=ctrl))

    def _block(self, block: dict[str, Wave]) -> tuple[np.ndarray, ...]:
        """Positions, speeds, accelerations and time of one block, without its ends, where no speed is known."""
        time = np.linspace(0.0, max(wave.lasts for wave in block.values()), SAMPLES)
        qpos = np.tile(self.sight.motion.qpos.mean(0), (len(time), 1))
        for joint, wave in block.items():
            qpos[:, self.model.joint(joint).qposadr[0]] = wave.at(time)
        qvel = np.gradient(qpos, time[1], axis=0)
        qacc = np.gradient(qvel, time[1], axis=0)
        return tuple(part[2:-2] for part in (qpos, qvel, qacc, time))

    def _last(self) -> str:
        """The last body that a driven joint carries."""
        model = self.model
        joint = driven(model)[-1]
        return model.body(int(model.jnt_bodyid[model.joint(joint).id])).name

    def _weight(self) -> float:
        """Of a known weight, kg: what the body that carries it weighs."""
        return float(EFFECTS["payload"].prior(self.sight.scales, self.model, self._last())["mass"])

    def _loaded(self, weight: float) -> mujoco.MjModel:
        own, effect = copy.copy(self.model), EFFECTS["payload"]
        probe = effect.probes(self.sight.scales, own, self._last())[-1]
        effect.law(own, self._last(), mass=weight, place=probe["place"])
        own.opt.disableflags |= NO_CONTACT
        return own
