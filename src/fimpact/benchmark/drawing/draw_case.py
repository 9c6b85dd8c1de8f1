"""Drawing a case: a robot, its motions and what is hidden in it, all from one seed."""

from dataclasses import replace

import numpy as np

from fimpact.benchmark.drawing.crowded_case import draw_crowd
from fimpact.benchmark.drawing.effect_size import (
    Trace,
    Unfit,
    estimate_size,
    fit_size,
    trace,
    visibility,
    with_all_runs,
)
from fimpact.benchmark.drawing.ingredients import (
    check_stable,
    errors_of,
    form_of,
    nuisance_of,
    planted,
    record,
    together,
)
from fimpact.benchmark.drawing.motions import draw_motion
from fimpact.benchmark.drawing.separable import SPLIT, best_split
from fimpact.benchmark.drawing.tangents import models
from fimpact.benchmark.planting.confusable_pairs import TWINS
from fimpact.benchmark.planting.out_of_catalogue import STRANGERS, known
from fimpact.benchmark.planting.planted_effects import PLANTS
from fimpact.benchmark.rigs.registry import RIGS, rig_of
from fimpact.benchmark.rigs.rig import Rig
from fimpact.benchmark.site_equivalence import places
from fimpact.benchmark.truth import Planted, Truth
from fimpact.recordings import Recording

KINDS = ("single", "null", "double", "outside", "twin", "crowd")
WORTH = (0.03, 0.3)  # of an odd effect in a crowd, the share of the force at its place
LAMBDA = dict.fromkeys(KINDS, (30.0, 3000.0)) | {"single": (3.0, 3000.0), "twin": (30.0, 300.0), "crowd": WORTH}
HIDDEN = 0.9  # concealment that half of the cases insist on
ALIKE, INDISTINCT = 0.9, 4.0  # cosine above, and non-centrality below, which no oracle can tell two effects apart
ATTEMPTS = {"twin": 4}  # draws of a case, 24 where nothing else is said: some twins hardly any motion makes
MUST_BE_HIDDEN = 4  # draws for which half of the cases insist on being hidden
SHARED = 3  # one in so many draws, the first, share their target


def draw_case(
    index: int, kind: str, seed: int = 0, system: str = "", spans: dict | None = None
) -> tuple[Recording, Truth]:
    """The recording of case `index` of a kind, and the truth behind it.

    Equal arguments give equal bytes. Indices run through all effects of the kind, in every rig where they can act.

    Args:
        kind: one of `KINDS`. system: draw in this rig only; "": in all.
        spans: kind -> smallest and largest non-centrality, of a crowd worth of its odd effect, instead of `LAMBDA`.

    Raises:
        ValueError: an unknown kind or system, or nothing of this kind fits in that rig.
    """
    if kind not in KINDS:
        raise ValueError(f"no kind is called {kind!r}; there are {', '.join(KINDS)}")
    low, high = (LAMBDA | (spans or {})).get(kind, (1.0, 1.0))
    attempts = ATTEMPTS.get(kind, 24)
    for attempt in range(attempts):
        rng = np.random.default_rng([seed, index, KINDS.index(kind), attempt])
        # The first attempts share their target, or hidden and faint effects would crowd out strong ones.
        shared = attempt < attempts // SHARED
        aim = np.random.default_rng([seed, index, KINDS.index(kind), 99 if shared else attempt])
        target = float(np.exp(aim.uniform(np.log(low), np.log(high))))
        draw = draw_crowd if kind == "crowd" else _draw
        try:
            return draw(rng, index, kind, system, target, attempt, (seed, index, KINDS.index(kind), attempt))
        except Unfit:
            continue
    raise ValueError(f"case {index} ({kind}, {system or 'any rig'}) found no fit in {attempts} draws; try another seed")


def _draw(rng, index, kind, system, target, attempt, seed):
    rig, choice, style = _choose(rng, index, kind, system)
    errors = errors_of(rng, rig)
    motion = draw_motion(rig, rng, style, _dof(rig, choice), models(rig, errors))
    stiff = max((known(name).stiff for name, _ in choice), default=1)
    stage, nuisance = nuisance_of(rng, replace(rig, coarse=rig.coarse * stiff), motion, errors)
    forms = [form_of(rng, stage, name, site) for name, site in choice]
    if kind == "twin":
        _check_alike(stage, choice, forms, target)
    own = list(zip(choice, forms, strict=True))[: 2 if kind == "double" else 1]
    traces = tuple(fit_size(stage, *place, known(place[0]), *form, target) for place, form in own)
    rival, shown = None, together(stage, traces)
    if kind == "twin":
        rival, cosine, left = _rival(rng, stage, choice, forms[1][0], traces[0])
        shown |= {"cosine": cosine, "left": left}
    if kind == "single" and must_be_hidden(index, system) and attempt < MUST_BE_HIDDEN and shown["kappa"] < HIDDEN:
        raise Unfit("not hidden enough")
    effects = tuple(planted(stage, site, t, name) for (name, site), t in zip(choice, traces, strict=False))
    truth = Truth(kind=kind, system=rig.name, effects=effects, rival=rival, seed=seed, **shown, **nuisance)
    recording = record(truth, motion)
    check_stable(stage, truth, motion, recording)
    return recording, truth


def _choose(rng, index, kind, system) -> tuple[Rig, list[tuple[str, str]], str]:
    """Rig, (effect, site) pairs and style of motion."""
    rigs = [rig_of(system)] if system else list(RIGS.values())
    if kind == "null":
        return rigs[index % len(rigs)], [], "lively"
    if kind == "twin":
        return _choose_twins(rng, index, rigs)
    shelf = STRANGERS if kind == "outside" else PLANTS
    pool = _pool(shelf, rigs)
    if not pool:
        raise ValueError(f"nothing of kind {kind!r} can act in {system!r}")
    # A fixed shuffle, so that the first cases of a small benchmark are not all of one family.
    rig, name = pool[np.random.default_rng(7).permutation(len(pool))[index % len(pool)]]
    first = (name, str(rng.choice(shelf[name].sites[rig.name])))
    return rig, [first] + ([_another(rng, rig, first)] if kind == "double" else []), "lively"


def _pool(shelf, rigs) -> list[tuple[Rig, str]]:
    return [(rig, name) for name, p in shelf.items() for rig in rigs if rig.name in p.sites]


def must_be_hidden(index: int, system: str | None) -> bool:
    """Tell whether this draw must be well hidden: every other one, and other effects in every pass through the pool."""
    rigs = [rig_of(system)] if system else list(RIGS.values())
    turn, place = divmod(index, len(_pool(PLANTS, rigs)))
    return bool((place + turn) % 2)


def _another(rng, rig, first):
    others = [(n, s) for n, p in PLANTS.items() for s in p.sites.get(rig.name, ()) if n != first[0] and s != first[1]]
    return others[rng.integers(len(others))]


def _choose_twins(rng, index, rigs):
    pool = [(rig, twin) for twin in TWINS for rig in rigs if rig.name in twin.systems]
    if not pool:
        raise ValueError(f"no twins can be made in {', '.join(r.name for r in rigs)}; leave out the system")
    rig, twin = pool[index % len(pool)]
    names = list(twin.names) if rng.random() < 0.5 else list(twin.names[::-1])
    place = rng.integers(len(known(names[0]).sites[rig.name]))
    return rig, [(n, known(n).sites[rig.name][place]) for n in names], twin.style


def _dof(rig, choice):
    """Motor that the motion is about: the one of the first site."""
    held = places(rig.naive, rig.channels, choice[0][1]) if choice else set()
    return next((i for i, joint in enumerate(rig.driven) if joint in held), 0)


def _signs(name: str) -> tuple[float, ...]:
    return (1.0, -1.0) if known(name).signed else (1.0,)


def _check_alike(stage, choice, forms, target) -> None:
    """Unfit if these two will hardly make twins."""
    (name, site), (rival, place) = choice
    (shape, own_sign), (rival_shape, *_) = forms
    own = estimate_size(stage, name, site, known(name), shape, own_sign, target)
    others = (estimate_size(stage, rival, place, known(rival), rival_shape, sign, target) for sign in _signs(rival))
    if not any(_twins(stage, own, other) for other in others):
        raise Unfit("the recordings would tell the twins apart")


def _twins(stage, own: Trace, other: Trace) -> bool:
    return _indistinct(*visibility(stage, own, other).left(0, 1))


def _indistinct(cosine: float, left: float) -> bool:
    return cosine > ALIKE and left < INDISTINCT


def _rival(rng, stage, choice, shape, own: Trace) -> tuple[Planted, float, float]:
    """The other twin, sized alike, and cosine and rest of the two in all runs; Unfit unless the recordings cannot tell
    them apart, by those for training, which lambda is of, or by any, and a further experiment can."""
    everything, (name, site) = with_all_runs(stage), choice[1]
    for sign in _signs(name):
        other = fit_size(stage, name, site, known(name), shape, sign, visibility(stage, own).size[0])
        if not _twins(stage, own, other):
            continue
        pairs = zip(choice, (own, other), strict=True)
        both = (trace(everything, effect, at, t.size, t.values) for (effect, at), t in pairs)
        shown = visibility(everything, *both).left(0, 1)
        if _indistinct(*shown) and best_split(stage, choice, [own, other], rng) >= SPLIT:
            return planted(stage, site, other, name), *shown
    raise Unfit("the recordings tell the twins apart, or no experiment would")
