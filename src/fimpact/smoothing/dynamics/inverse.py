"""Inverse dynamics along a trajectory: what an edit of the model is as a force that is held over a sample.

The force that a motion needs is linear in the ten inertial parameters of each body (Atkeson, An, Hollerbach, Int. J.
Robotics Research 5(3), 1986), in damping, armature and stiffness. One pass over the samples gives all that columns of
these take; nothing is simulated.
"""

from functools import cached_property

import mujoco
import numpy as np

from fimpact.smoothing.dynamics.body_inertia import by_moments, carried_bodies, cross_matrix, inertial_parameters
from fimpact.smoothing.dynamics.laws import middle
from fimpact.smoothing.dynamics.plain_motors import given_by, is_plain
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import BALL, FREE, States

INERTIAL = ("body_mass", "body_inertia", "body_ipos", "body_iquat")
OF_JOINTS = ("dof_damping", "dof_dampingpoly", "dof_armature", "jnt_stiffness", "jnt_stiffnesspoly", "qpos_spring")
RESTING = ("jnt_stiffness", "jnt_stiffnesspoly", "qpos_spring", "gravity")  # act by position alone
OF_MOTORS = tuple(f"actuator_{name}" for name in "gainprm biasprm biastype forcerange forcelimited".split())
# Arrays of a model that laws edit.
EDITED = (
    *INERTIAL,
    *OF_JOINTS,
    *OF_MOTORS,
    *"body_gravcomp actuator_dynprm "
    "geom_pos geom_quat geom_size geom_friction geom_solref geom_condim pair_friction pair_solref "
    "pair_dim pair_margin".split(),
)
_S = mujoco.mjtSensor
MOTOR_FORCES = tuple(map(int, (_S.mjSENS_ACTUATORFRC, _S.mjSENS_JOINTACTFRC, _S.mjSENS_TENDONACTFRC)))
WEIGHED = (int(mujoco.mjtSensor.mjSENS_FORCE), int(mujoco.mjtSensor.mjSENS_TORQUE))
FALLING = tuple(map(int, (_S.mjSENS_ACCELEROMETER, _S.mjSENS_FRAMELINACC)))
OF_MASS = tuple(map(int, (_S.mjSENS_SUBTREECOM, _S.mjSENS_SUBTREELINVEL, _S.mjSENS_SUBTREEANGMOM)))
BODY = int(mujoco.mjtObj.mjOBJ_BODY)  # the frame in which a body's mass lies, for sensors
XBODY = int(mujoco.mjtObj.mjOBJ_XBODY)


def edits(after: mujoco.MjModel, before: mujoco.MjModel) -> set[str]:
    """Names of the arrays in which two models differ, "gravity" among them."""
    found = {name for name in EDITED if not np.array_equal(getattr(after, name), getattr(before, name))}
    return found if np.array_equal(after.opt.gravity, before.opt.gravity) else found | {"gravity"}


class Inverse:
    """Inverse dynamics along `states`, in the middle of each sample."""

    def __init__(self, track: Track, states: States):
        after = track.next(states)
        qacc = (after.qvel - states.qvel) / track.period
        ends = np.flatnonzero(track.last & (track.lengths[track.run_of] > 1))
        qacc[ends] = qacc[ends - 1]
        self._begin(track, *middle(track, states), qacc)

    @classmethod
    def along(cls, track: Track, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> "Inverse":
        """Inverse dynamics along any motion of the track's model: qpos (n, nq), qvel and qacc (n, nv)."""
        own = cls.__new__(cls)
        own._begin(track, qpos, qvel, qacc)
        return own

    def _begin(self, track: Track, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> None:
        self.track, self.model = track, track.model
        self.qpos, self.qvel, self.qacc = qpos, qvel, qacc
        self._regressors: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def change(self, after: mujoco.MjModel, before: mujoco.MjModel, told: np.ndarray) -> np.ndarray | None:
        """The force, (N, nv), that acts more on the motion under `after` than under `before`, or None where an edit is
        no such force.

        Args:
            told: commands, (N, nu), under which gains are judged.
        """
        edited = edits(after, before)
        if edited - {*INERTIAL, *OF_JOINTS, *OF_MOTORS, "gravity"}:
            return None
        out = np.zeros_like(self.qvel)
        if edited & {*INERTIAL, "gravity"}:
            if before.body_gravcomp.any() or self._weighed(after, before) or self._shown(edited):
                return None
            out -= self._inertial(after) - self._inertial(before) if "gravity" in edited else self._moved(after, before)
        if edited & set(OF_JOINTS):
            own = self._of_joints(after), self._of_joints(before)
            if own[0] is None or own[1] is None:
                return None
            out -= own[0] - own[1]
        if edited & set(OF_MOTORS):
            given = self._given(after, before, told)
            if given is None:
                return None
            out += given
        return out

    def _weighed(self, after: mujoco.MjModel, before: mujoco.MjModel) -> bool:
        """Whether a sensor feels what an edited body weighs, not only how it moves."""
        changed = [(getattr(after, n) != getattr(before, n)).reshape(after.nbody, -1).any(1) for n in INERTIAL]
        edited = np.any(changed, axis=0) | (after.opt.gravity != before.opt.gravity).any()
        return any(edited[carried_bodies(self.model, int(self.model.site_bodyid[site]))].any() for site in self._scales)

    def _shown(self, edited: set[str]) -> bool:
        """Whether a sensor shows the edit itself: accelerometers gravity, others where a body's mass lies."""
        kinds = FALLING if "gravity" in edited else ()
        names = {name.partition("[")[0] for name in self.track.recording.channels}
        inertial = any(int(self.model.sensor(name).objtype[0]) == BODY for name in names)
        return self._has(kinds) or (bool(edited & set(INERTIAL)) and (inertial or self._has(OF_MASS)))

    @cached_property
    def _scales(self) -> set[int]:
        """Sites of sensors between a body and what carries it."""
        names = {name.partition("[")[0] for name in self.track.recording.channels}
        sensors = [self.model.sensor(name) for name in names]
        return {int(sensor.objid[0]) for sensor in sensors if int(sensor.type[0]) in WEIGHED}

    @cached_property
    def _feels_motors(self) -> bool:
        return self._has((*WEIGHED, *MOTOR_FORCES))

    def _has(self, kinds: tuple[int, ...]) -> bool:
        names = {name.partition("[")[0] for name in self.track.recording.channels}
        return any(int(self.model.sensor(name).type[0]) in kinds for name in names)

    @cached_property
    def _motion(self) -> tuple[np.ndarray, ...]:
        """Of each sample and body: its place (N, nb, 3), axes (N, nb, 3, 3), centre (N, nb, 3) of its tree, velocity
        and acceleration in its own axes (N, nb, 6), turning first, without gravity; and MuJoCo's `cdof`, (N, nv, 6),
        which belongs to the centres."""
        model, count = self.model, len(self.qpos)
        data, nb = mujoco.MjData(model), model.nbody
        free = model.opt.gravity.copy()
        place, axes, centre = np.empty((count, nb, 3)), np.empty((count, nb, 9)), np.empty((count, nb, 3))
        moving, cdof = np.zeros((2, count, nb, 6)), np.empty((count, model.nv, 6))
        own = data.qpos, data.qvel, data.qacc, data.xpos, data.xmat, data.subtree_com, data.cdof
        model.opt.gravity[:] = 0.0
        try:
            for k in range(count):
                own[0][:], own[1][:], own[2][:] = self.qpos[k], self.qvel[k], self.qacc[k]
                mujoco.mj_kinematics(model, data)
                mujoco.mj_comPos(model, data)
                mujoco.mj_comVel(model, data)
                mujoco.mj_rnePostConstraint(model, data)
                place[k], axes[k], centre[k], cdof[k] = own[3], own[4], own[5], own[6]
                for body in range(1, nb):
                    mujoco.mj_objectVelocity(model, data, XBODY, body, moving[0, k, body], 1)
                    mujoco.mj_objectAcceleration(model, data, XBODY, body, moving[1, k, body], 1)
        finally:
            model.opt.gravity[:] = free
        return place, axes.reshape(count, nb, 3, 3), centre[:, model.body_rootid], moving[0], moving[1], cdof

    def regressor(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """What a unit of each inertial parameter of `body` takes of force, (N, nv, 10), and a unit of gravity along
        each axis of the world for its mass and first moments, (N, nv, 4, 3).

        Parameters: mass, mass times centre of mass, and moments of inertia xx, yy, zz, xy, xz, yz about the body's
        origin, all in its axes.
        """
        if body not in self._regressors:
            self._regressors[body] = self._regressor(body)
        return self._regressors[body]

    def _regressor(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        *parts, cdof = self._motion
        place, axes, centre, velocity, acceleration = (part[:, body] for part in parts)
        turn, spin, push = velocity[:, :3], acceleration[:, :3], acceleration[:, 3:]
        # Forces and moments, (N, 3, 10), of each parameter, in the body's axes about its origin.
        force, moment = np.zeros((2, len(turn), 3, 10))
        turning = cross_matrix(turn)
        force[:, :, 0] = push
        force[:, :, 1:4] = cross_matrix(spin) + turning @ turning
        moment[:, :, 1:4] = -cross_matrix(push)
        moment[:, :, 4:] = by_moments(spin) + turning @ by_moments(turn)
        jacobian = self._jacobian(body, place, axes, cdof, centre)
        out = np.einsum("kji,kip->kjp", jacobian[..., :3], force) + np.einsum("kji,kip->kjp", jacobian[..., 3:], moment)
        weight = np.zeros((len(turn), len(jacobian[0]), 4, 3))
        back = axes.swapaxes(1, 2)  # of the world in the body's axes
        weight[:, :, 0] = jacobian[..., :3] @ back
        for a, unit in enumerate(np.eye(3)):
            weight[:, :, 1 + a] = jacobian[..., 3:] @ (cross_matrix(np.tile(unit, (len(turn), 1))) @ back)
        return out, weight

    def _jacobian(self, body: int, place, axes, cdof, centre) -> np.ndarray:
        """Of the body's origin, (N, nv, 6), moving first, in the body's axes."""
        moves = np.zeros(self.model.nv, bool)
        dof = self.model.body_dofadr[body] + self.model.body_dofnum[body] - 1
        ancestor = body
        while ancestor and self.model.body_dofnum[ancestor] == 0:
            ancestor = self.model.body_parentid[ancestor]
        dof = self.model.body_dofadr[ancestor] + self.model.body_dofnum[ancestor] - 1 if ancestor else -1
        while dof >= 0:
            moves[dof] = True
            dof = self.model.dof_parentid[dof]
        turning, moving = cdof[:, :, :3], cdof[:, :, 3:]
        moving = moving + np.cross(turning, (place - centre)[:, None])
        return np.concatenate([moving @ axes, turning @ axes], 2) * moves[:, None]

    def _moved(self, after: mujoco.MjModel, before: mujoco.MjModel) -> np.ndarray:
        out = np.zeros_like(self.qvel)
        for body in range(1, self.model.nbody):
            change = inertial_parameters(after, body) - inertial_parameters(before, body)
            if change.any():
                force, weight = self.regressor(body)
                out += force @ change - np.einsum("kjpg,p,g->kj", weight, change[:4], _gravity(after))
        return out

    def _inertial(self, model: mujoco.MjModel) -> np.ndarray:
        out = np.zeros_like(self.qvel)
        for body in range(1, model.nbody):
            own = inertial_parameters(model, body)
            force, weight = self.regressor(body)
            out += force @ own - np.einsum("kjpg,p,g->kj", weight, own[:4], _gravity(model))
        return out

    def _of_joints(self, model: mujoco.MjModel) -> np.ndarray | None:
        speed, off = self.qvel, model.opt.disableflags
        out = model.dof_armature * self.qacc
        if not off & mujoco.mjtDisableBit.mjDSBL_DAMPER:
            out = out + model.dof_damping * speed
            for power, poly in enumerate(model.dof_dampingpoly.T):
                out = out + poly * speed * np.abs(speed) ** (power + 1)
        for joint in range(0 if off & mujoco.mjtDisableBit.mjDSBL_SPRING else model.njnt):
            stiff = np.r_[model.jnt_stiffness[joint], model.jnt_stiffnesspoly[joint]]
            if not stiff.any():
                continue
            if model.jnt_type[joint] in (FREE, BALL):
                return None
            q = model.jnt_qposadr[joint]
            bent = self.qpos[:, q] - model.qpos_spring[q]
            out[:, model.jnt_dofadr[joint]] += sum(k * bent ** (i + 1) for i, k in enumerate(stiff))
        return out

    def _given(self, after: mujoco.MjModel, before: mujoco.MjModel, told: np.ndarray) -> np.ndarray | None:
        """What motors whose torque is their command give more; None where one is no such motor."""
        out = np.zeros_like(self.qvel)
        changed = [(getattr(after, n) != getattr(before, n)).reshape(after.nu, -1).any(1) for n in OF_MOTORS]
        for motor in map(int, np.flatnonzero(np.any(changed, axis=0))):
            if not (is_plain(before, motor) and is_plain(after, motor)) or self._feels_motors:
                return None
            dof = before.jnt_dofadr[before.actuator_trnid[motor, 0]]
            out[:, dof] += given_by(after, motor, told[:, motor]) - given_by(before, motor, told[:, motor])
        return out


def _gravity(model: mujoco.MjModel) -> np.ndarray:
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if off else model.opt.gravity
