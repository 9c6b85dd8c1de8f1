"""How gears that give are put into a world: a joint between motor and link."""

import numpy as np

from fimpact.benchmark.planting.ground_truth import FIRM, World

RINGING = 2e-3  # s, damping of an elastic gear over its stiffness
STOP = (0.001, 1.0)  # solref of hard stops, s and 1: at 5 ms the shaft overran them by more than half of the play


def _behind(world: World, site: str):
    """A joint between motor and link: encoder and rotor stay with the motor, bearing and springs go to the link."""
    joint = world.spec.joint(site)
    behind = joint.parent.add_joint(name=f"{site}_behind", type=joint.type, axis=joint.axis)
    behind.armature, behind.stiffness, behind.damping = 0.0, np.zeros(3), np.zeros(3)
    world.shafts.append(behind.name)
    link = world.spec.add_tendon(name=f"{site}_link", stiffness=joint.stiffness, damping=joint.damping)
    link.springlength = np.full(2, joint.springref * world.angle)
    link.frictionloss, joint.frictionloss = joint.frictionloss, 0.0
    link.solref_friction, link.solimp_friction = joint.solref_friction, joint.solimp_friction
    link.wrap_joint(site, 1.0)
    link.wrap_joint(behind.name, 1.0)
    joint.stiffness, joint.damping = np.zeros(3), np.zeros(3)
    return behind


def backlash(world: World, site: str, gap: float) -> None:
    """Play of `gap` rad between motor and link."""
    slack, half = _behind(world, site), gap / 2 / world.angle
    slack.limited, slack.range = True, [-half, half]
    slack.solref_limit, slack.solimp_limit = STOP, FIRM
    slack.damping = np.array([1e-3, 0, 0])


def joint_elasticity(world: World, site: str, compliance: float) -> None:
    """A gear that gives: rad/(N m) between motor and link, and swings out within some milliseconds."""
    shaft = _behind(world, site)
    shaft.stiffness, shaft.damping = np.array([1 / compliance, 0, 0]), np.array([RINGING / compliance, 0, 0])
