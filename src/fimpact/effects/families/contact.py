"""How surfaces touch. A site is an explicit contact pair, or a ground: then all of its contacts change alike."""

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical
from fimpact.effects.base import Coefficient, Effect
from fimpact.effects.families.environment import without_midphase
from fimpact.effects.native import exporting
from fimpact.effects.touching import ROUND, pairs_of, partners

SOFT = "Todorov, Convex and analytically-invertible dynamics with contacts and constraints, ICRA 2014"
GUESSED = "stiffness and damping of contacts are not measured but chosen, to a factor of a few"
LEAST = 1e-5  # MuJoCo's smallest coefficient of friction
SLIDING, TWISTING, FULL = 3, 4, 6  # condim from which on a contact has that friction; FULL: rolling friction too
BOX, BLUNT = int(mujoco.mjtGeom.mjGEOM_BOX), 0.9  # the largest radius of an edge, of half the box's shortest side
ASIDE = 0.1  # of the largest offset from the centre of mass, below which a corner does not lie to that side


def touching(model, site: str) -> tuple[list[int], list[int]]:
    """Rows of the contact pairs and of the geoms that `site` stands for.

    Without explicit pairs MuJoCo mixes the properties of two geoms, so both sides are changed.
    """
    named = [model.pair(i).name for i in range(model.npair)]
    if site in named:
        return [named.index(site)], []
    geom = model.geom(site).id
    others = partners(model, geom)
    return pairs_of(model, geom), [geom, *others] if others else []


def sliding_friction(model, site, change):
    """Both tangential coefficients."""
    pairs, geoms = touching(model, site)
    model.pair_friction[pairs, :2] = _raised(model.pair_friction[pairs, :2], change)
    model.geom_friction[geoms, 0] = _raised(model.geom_friction[geoms, 0], change)


def contact_stiffness(model, site, change):
    """Stiffness is -solref[0], or goes with 1/(timeconst dampratio)^2; damping is kept."""
    _stiffen(model, site, lambda direct: [1 + change, 1.0] if direct else [1.0, (1 + change) ** -0.5])


def contact_damping(model, site, change):
    """Damping is -solref[1], or goes with 1/timeconst; stiffness is kept."""
    _stiffen(model, site, lambda direct: [1.0, 1 + change] if direct else [1 / (1 + change), 1 + change])


def rolling_friction(model, site, coefficient):
    """Needs contacts with all six dimensions; what other friction they did not have is opened as little as may be."""
    if coefficient == 0:
        return
    pairs, geoms = touching(model, site)
    for pair in pairs:
        friction = model.pair_friction[pair]
        _open(model.pair_dim[pair], friction[:2], friction[2:3], friction[3:], coefficient)
    for geom, dimension in zip(geoms, _dimensions(model, geoms), strict=True):
        friction = model.geom_friction[geom]
        _open(dimension, friction[:1], friction[1:2], friction[2:], coefficient)
    model.pair_dim[pairs], model.geom_condim[geoms] = FULL, FULL


def rounded_edge(model, site, radius):
    """Spheres and capsules grow and their centres move inwards, so that the faces stay where they are; a box shrinks,
    and is touched as far from what is left of it."""
    if radius == 0:
        return
    for geom in _round(model, site):
        offset = model.geom_pos[geom] - model.body_ipos[model.geom_bodyid[geom]]
        outer = np.abs(offset) > ASIDE * np.abs(offset).max()
        change = max(radius, 1e-6 - model.geom_size[geom, 0])
        model.geom_pos[geom] -= change * np.sign(offset) * outer
        model.geom_size[geom, 0] += change
        model.geom_rbound[geom] += change
        model.geom_aabb[geom, 3:] += change
    for pair, geom in _boxes(model, site):
        change = np.clip(radius, -model.pair_margin[pair], BLUNT * model.geom_size[geom].min())
        model.geom_size[geom] -= change
        model.pair_margin[pair] += change
    without_midphase(model)


def _raised(friction, change):
    return np.maximum(friction + change, LEAST)


def _stiffen(model, site, factors) -> None:
    pairs, geoms = touching(model, site)
    for array, rows in ((model.pair_solref, pairs), (model.geom_solref, geoms)):
        for row in rows:
            array[row] *= factors(array[row, 0] <= 0)


def _open(dimension, sliding, torsion, rolling, coefficient) -> None:
    for friction, opened, least in ((sliding, SLIDING, LEAST), (torsion, TWISTING, LEAST), (rolling, FULL, 0.0)):
        if dimension < opened:
            friction[:] = least
    rolling += coefficient


def _dimensions(model, geoms) -> np.ndarray:
    """Of the contacts of a ground, the first of `geoms`, with each of the others: MuJoCo takes the larger of both, or
    that of the higher priority. The ground itself counts with the largest."""
    own, rank = model.geom_condim[geoms], model.geom_priority[geoms]
    mixed = np.where(rank == rank[:1], np.maximum(own, own[:1]), np.where(rank > rank[:1], own, own[:1]))
    mixed[:1] = mixed.max(initial=0)
    return mixed


def _round(model, site) -> list[int]:
    pairs, geoms = touching(model, site)
    both = {*model.pair_geom1[pairs], *model.pair_geom2[pairs], *geoms}
    moving = [int(g) for g in both if model.body_weldid[model.geom_bodyid[g]] != 0]
    return sorted(g for g in moving if model.geom_type[g] in ROUND)


def _boxes(model, site) -> list[tuple[int, int]]:
    """Explicit pairs of `site` and the moving box in each that no other pair lists: only pairs have a margin of their
    own."""
    both = np.concatenate([model.pair_geom1, model.pair_geom2]).tolist()
    return [
        (pair, int(geom))
        for pair in touching(model, site)[0]
        for geom in (model.pair_geom1[pair], model.pair_geom2[pair])
        if model.geom_type[geom] == BOX and model.body_weldid[model.geom_bodyid[geom]] and both.count(geom) == 1
    ]


def _with_edges(model, channels=()):
    """Contacts of spheres, capsules and boxes that move."""
    return [site for site in sites.contacts(model) if _round(model, site) or _boxes(model, site)]


EFFECTS = (
    Effect(
        name="sliding_friction",
        family="contact",
        equation="μ' = μ + Δμ",
        sentence="The surface is more or less slippery than the model says.",
        reference="Coulomb 1785; MuJoCo documentation, Computation, contact",
        enters="model",
        coefficients=(Coefficient("change", "1", low=-5.0, high=5.0),),
        sites=sites.contacts,
        touching=True,
        probes=lambda scales, model, site: [{"change": typical.SMALL}],
        law=sliding_friction,
        neutral={"change": 0.0},
        export=exporting(sliding_friction),
        prior=priors.fixed(change=0.3),
        prior_source="handbooks give coefficients of dry friction of one pair of materials to some .3",
    ),
    Effect(
        name="contact_stiffness",
        family="contact",
        equation="k' = (1 + ε) k, damping kept",
        sentence="The surface gives less (or, ε < 0, more) under load than the model says.",
        reference=SOFT,
        enters="model",
        coefficients=(Coefficient("change", "1", low=-0.99, high=1000.0),),
        sites=sites.contacts,
        touching=True,
        probes=lambda scales, model, site: [{"change": 2 * typical.SMALL}],
        law=contact_stiffness,
        neutral={"change": 0.0},
        export=exporting(contact_stiffness),
        prior=priors.fixed(change=3.0),
        prior_source=GUESSED,
    ),
    Effect(
        name="contact_damping",
        family="contact",
        equation="c' = (1 + ε) c, stiffness kept",
        sentence="The surface swallows more (or, ε < 0, less) of an impact: things bounce less, or more.",
        reference=SOFT,
        enters="model",
        coefficients=(Coefficient("change", "1", low=-0.99, high=1000.0),),
        sites=sites.contacts,
        touching=True,
        probes=lambda scales, model, site: [{"change": 2 * typical.SMALL}],
        law=contact_damping,
        neutral={"change": 0.0},
        export=exporting(contact_damping),
        prior=priors.fixed(change=3.0),
        prior_source=GUESSED,
    ),
    Effect(
        name="rolling_friction",
        family="contact",
        equation="|torque| ≤ ρ × normal force, against rolling",
        sentence="The contact resists rolling, as soft tyres, carpet and flattened corners do.",
        reference="Johnson, Contact Mechanics, Cambridge University Press, 1985, ch. 9",
        enters="model",
        coefficients=(Coefficient("coefficient", "m", low=0.0),),
        sites=sites.contacts,
        touching=True,
        probes=lambda scales, model, site: [
            {"coefficient": float(size)} for size in scales.length * typical.SMALL * np.geomspace(0.1, 1.0, 3)
        ],
        law=rolling_friction,
        neutral={"coefficient": 0.0},
        linear=False,  # MuJoCo softens what little friction there is in the square of its coefficient
        export=exporting(rolling_friction),
        prior=priors.of_length(coefficient=0.02),
        prior_source="handbooks: up to two hundredths of the radius for tyres on hard ground",
    ),
    Effect(
        name="rounded_edge",
        family="contact",
        equation="r' = r + Δr, faces in place",
        sentence="Corners and tips are blunter (or, Δr < 0, sharper) than drawn.",
        reference="Pfrommer, Halm, Posa, ContactNets, CoRL 2020",
        enters="model",
        coefficients=(Coefficient("radius", "m"),),
        sites=_with_edges,
        touching=True,
        probes=lambda scales, model, site: [{"radius": typical.SMALL / 10 * scales.length}],
        law=rounded_edge,
        neutral={"radius": 0.0},
        export=exporting(rounded_edge),
        prior=priors.of_length(radius=0.02),
        prior_source="edges are broken or worn by up to two hundredths of a part's size",
    ),
)
