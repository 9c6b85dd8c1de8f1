"""Simulation of gears that give: the rotor behind each has a coordinate of its own.

The joint of a model moves the link. Here it moves the rotor, with the encoder and the motor on it, and a second joint
behind it the link by as much less as the rotor is ahead; bearings and springs of the joint go to the link, as a tendon
over both. Of hinges that share a body only the last is exact: the second joint comes after all of them.

References: Spong, J. Dyn. Syst. Meas. Control 109(4), 1987; Nordin, Gutman, Automatica 38(10), 2002.
"""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from fimpact.deciding import HELD
from fimpact.effects.base import Placed
from fimpact.effects.gears import loose
from fimpact.simulation.compiled import behind_name
from fimpact.simulation.servo_steps import IMPLICIT
from fimpact.simulation.simulator import Simulator

GIVES = 0.3  # of half a play, over which its ends become hard
STIFF = 1e6  # times what would swing within a time step: a gear that gives no less is rigid
LEAST = 1e-3  # of the inertia that a joint feels: a rotor lighter than that follows its motor at once
# What of a model differs between hypotheses, by degree of freedom, joint or position.
OF_PARTS = {
    "dofs": ("dof_armature", "dof_damping", "dof_dampingpoly", "dof_frictionloss", "dof_solref", "dof_solimp"),
    "joints": ("jnt_stiffness", "jnt_stiffnesspoly"),
    "places": ("qpos_spring",),
}
# The bearing and the spring of a joint, and where a tendon has them.
OF_LINKS = {
    "tendon_damping": "dof_damping",
    "tendon_dampingpoly": "dof_dampingpoly",
    "tendon_frictionloss": "dof_frictionloss",
    "tendon_solref_fri": "dof_solref",
    "tendon_solimp_fri": "dof_solimp",
    "tendon_stiffness": "jnt_stiffness",
    "tendon_stiffnesspoly": "jnt_stiffnesspoly",
}


class Rotors:
    """Simulates models of `simulator` in which the gears at joints `sites` give."""

    def __init__(self, simulator: Simulator, sites: Sequence[str]):
        self.sites = tuple(sites)
        self.simulator = Simulator(simulator.recording, simulator.refine, simulator.apart, self.sites)
        outer, inner = simulator.base, self.simulator.base
        self.tendons = [inner.tendon(behind_name(site)).id for site in sites]
        self.own = _addresses(outer, sites)
        self.behind = _addresses(inner, [behind_name(site) for site in sites])
        sizes = {"dofs": inner.nv, "joints": inner.njnt, "places": inner.nq}
        self.kept = {name: np.delete(np.arange(size), self.behind[name]) for name, size in sizes.items()}
        named = [name for name in dir(outer) if name.startswith(("body_", "geom_", "pair_", "actuator_"))]
        self.shared = [name for name in named if _is_shared(getattr(outer, name), getattr(inner, name))]
        self._data = mujoco.MjData(inner)

    def model(self, outer: mujoco.MjModel, gears: Sequence[Placed]) -> mujoco.MjModel:
        """The model `outer`, N m and rad, with gears that give as `gears` have it, one at each of the sites."""
        inner = copy.copy(self.simulator.base)
        for name in self.shared:
            getattr(inner, name)[:] = getattr(outer, name)
        for part, names in OF_PARTS.items():
            for name in names:
                getattr(inner, name)[self.kept[part]] = getattr(outer, name)
        inner.dof_armature[self.behind["dofs"]] = 0.0
        inner.opt.gravity[:], inner.opt.timestep = outer.opt.gravity, outer.opt.timestep
        inner.opt.disableflags, inner.opt.integrator = outer.opt.disableflags, IMPLICIT
        for gear in gears:
            self._give(inner, outer, self.sites.index(gear.site), gear)
        mujoco.mj_setConst(inner, self._data)
        # Contacts are as soft as they were: MuJoCo scales their stiffness by how much a body weighs at rest.
        inner.body_invweight0[:] = outer.body_invweight0
        # A spring that is stiffer than the step acts a step later, as a servo's does (`servo_steps`).
        behind, step = self.behind["dofs"], outer.opt.timestep
        stiffness = inner.jnt_stiffness[self.behind["joints"]]
        stiff = step**2 * stiffness * inner.dof_invweight0[behind] > HELD
        inner.dof_damping[behind] += step * stiffness * stiff
        return inner

    def _give(self, inner: mujoco.MjModel, outer: mujoco.MjModel, at: int, gear: Placed) -> None:
        dof, joint, place = (int(self.own[part][at]) for part in ("dofs", "joints", "places"))
        tendon, kept = self.tendons[at], {part: int(self.kept[part][self.own[part][at]]) for part in self.kept}
        for name, whence in OF_LINKS.items():
            getattr(inner, name)[tendon] = getattr(outer, whence)[dof if whence.startswith("dof") else joint]
            if whence not in ("dof_solref", "dof_solimp"):
                part = "dofs" if whence.startswith("dof") else "joints"
                getattr(inner, whence)[kept[part]] = 0.0
        inner.tendon_lengthspring[tendon] = outer.qpos_spring[place]
        inner.dof_armature[kept["dofs"]] = max(outer.dof_armature[dof], LEAST * outer.dof_M0[dof])
        behind, second = int(self.behind["dofs"][at]), int(self.behind["joints"][at])
        if gear.effect.law is loose:
            half = gear.values["gap"] / 2
            inner.jnt_limited[second], inner.jnt_range[second] = True, (-half, half)
            # As tight as MuJoCo keeps it (refsafe), and the same at half the step.
            inner.jnt_solref[second] = 2 * self.simulator.base.opt.timestep, 1.0
            inner.jnt_solimp[second, 2] = GIVES * half
            return
        rigid = STIFF * outer.dof_M0[dof] / outer.opt.timestep**2
        stiffness = 1 / max(gear.values["compliance"], 1 / rigid)
        inner.jnt_stiffness[second] = stiffness
        inner.dof_damping[behind] = stiffness * gear.values["retardation"]

    def advance(
        self, outer, gears: Sequence[Placed], qpos, qvel, act, ctrl, force, every=False
    ) -> tuple[np.ndarray, ...]:
        """Advance n states by one sample, as `Simulator.advance` does.

        Args:
            gears: one at each of the sites, in their order. act: states of actuators, (n, na), and then lead and its
                rate of each rotor, rad and rad/s or m and m/s.
        """
        rotors = act[:, outer.na :].reshape(len(act), -1, 2)
        places = self._inner(qpos, rotors[:, :, 0], "places")
        rates = self._inner(qvel, rotors[:, :, 1], "dofs")
        pushed = np.zeros_like(rates)
        pushed[:, self.kept["dofs"]] = force
        pushed[:, self.behind["dofs"]] = force[:, self.own["dofs"]]  # what acts on the link moves both
        own = self.model(outer, gears)
        qpos, qvel, after, read = self.simulator.advance(own, places, rates, act[:, : outer.na], ctrl, pushed, every)
        ends = [self._outer(*own) for own in ((qpos, "places"), (qvel, "dofs"))]
        turned = np.stack([ends[0][1], ends[1][1]], 2).reshape(len(act), -1)
        return ends[0][0], ends[1][0], np.concatenate([after, turned], 1), read

    def _inner(self, outer: np.ndarray, ahead: np.ndarray, part: str) -> np.ndarray:
        """Coordinates of rotors and links, (n, ...), of those of joints and how far rotors are `ahead`, (n, g)."""
        out = np.zeros((len(outer), outer.shape[1] + len(self.sites)))
        out[:, self.kept[part]] = outer
        out[:, self.kept[part][self.own[part]]] += ahead
        out[:, self.behind[part]] = -ahead
        return out

    def _outer(self, inner: np.ndarray, part: str) -> tuple[np.ndarray, np.ndarray]:
        out, ahead = inner[:, self.kept[part]], -inner[:, self.behind[part]]
        out[:, self.own[part]] -= ahead
        return out, ahead


def _is_shared(outer: object, inner: object) -> bool:
    """Whether both models have the same there. Whole numbers may be addresses, which a joint more has moved, or tell
    of what kind a motor or a contact is, which an effect may edit."""
    if not (isinstance(outer, np.ndarray) and isinstance(inner, np.ndarray) and outer.shape == inner.shape):
        return False
    return outer.dtype == float or np.array_equal(outer, inner)


def _addresses(model: mujoco.MjModel, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Numbers of the degrees of freedom, joints and positions of the joints `names`."""
    joints = [model.joint(name) for name in names]
    return {
        "dofs": np.array([int(joint.dofadr[0]) for joint in joints], int),
        "joints": np.array([joint.id for joint in joints], int),
        "places": np.array([int(joint.qposadr[0]) for joint in joints], int),
    }
