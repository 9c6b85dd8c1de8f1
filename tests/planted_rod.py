"""A driven pendulum with a dry pivot, recorded by MuJoCo C."""

import mujoco
import numpy as np

from fimpact.recordings import Recording, Run, Unknown

XML = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.02" armature="0.003"/>
<geom name="bar" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
NOISE, PERIOD, SAMPLES = 2e-4, 0.01, 40


def record(friction: float, xml: str = XML, folder: str = ".") -> Recording:
    """A driven pendulum with dry friction, lighter damped than its model says; two runs of six are held out."""
    rng, spec = np.random.default_rng(1), mujoco.MjSpec.from_string(xml)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    truth = spec.compile()
    truth.dof_frictionloss[:], truth.dof_damping[:] = friction, 0.017
    runs = []
    for number in range(6):
        data, time = mujoco.MjData(truth), np.arange(SAMPLES) * PERIOD
        data.qpos[:] = rng.uniform(-1, 1)
        ctrl = 0.5 * np.sin(2 * np.pi * rng.uniform(1, 3) * time + rng.uniform(0, 6))[:, None]
        angle = []
        for u in ctrl:
            angle.append(data.qpos.copy())
            data.ctrl[:] = u
            mujoco.mj_step(truth, data, nstep=5)
        measured = np.array(angle) + NOISE * rng.standard_normal((SAMPLES, 1))
        runs.append(Run(f"run {number}", ctrl, measured, number >= 4))
    unknowns = (Unknown("mass", "rod", 0.2), Unknown("damping", "pivot", 0.3))
    return Recording(xml, folder, PERIOD, ("angle",), tuple(runs), unknowns, np.array([NOISE]), np.full(2, np.inf), 0.2)
