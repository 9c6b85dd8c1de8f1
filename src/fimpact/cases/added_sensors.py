"""Sensors that a log has and the naive MJCF lacks: added to it, for a joint, a body or a site."""

from xml.etree import ElementTree

from fimpact.cases import enums
from fimpact.cases.channels import span
from fimpact.cases.errors import CaseError, listed, one_of
from fimpact.cases.models.naive import FORBIDDEN, Naive, body_element, joint_of
from fimpact.cases.units import factor, same_dimension

FRAME = {
    "position": "framepos",
    "orientation": "framequat",
    "velocity": "framelinvel",
    "angular_velocity": "frameangvel",
    "acceleration": "accelerometer",
    "rotation_rate": "gyro",
    "force": "force",
    "torque": "torque",
}
AT_SITE = ("accelerometer", "gyro", "force", "torque")


def place_sensors(naive: Naive, measurements: dict) -> None:
    """Add to the tree of `naive` the sensors that `measurements` name and the MJCF lacks.

    Raises:
        CaseError: a name that the MJCF does not have, or a quantity that the object has not.
    """
    block = ElementTree.SubElement(naive.tree, "sensor")
    for key, entry in measurements.items():
        where, described = f"measurements.{key}", [kind for kind in ("joint", "body", "site") if kind in entry]
        if set(key) & set(f"{FORBIDDEN}[]"):
            raise CaseError(f"{where} has one of {' '.join(f'{FORBIDDEN}[]')} in its name; rename it")
        if key in naive.names("sensor"):
            if described or "quantity" in entry:
                raise CaseError(
                    f"{where} is a sensor of the MJCF, which says what it measures; remove "
                    f"{' and '.join([*described, *({'quantity'} & set(entry))])}, or choose another name"
                )
            continue
        if not described and key not in naive.names("joint"):
            raise CaseError(
                f"{where} is no sensor or joint of {naive.path.name}; "
                f"{listed([*naive.names('sensor'), *naive.names('joint')], key)}; "
                "correct the name, or add `joint:`, `body:` or `site:`"
            )
        if len(described) > 1:
            raise CaseError(
                f"{where} has {' and '.join(described)}; allowed: one of joint, body, site; remove the rest"
            )
        _add(naive, block, key, entry, where)


def _add(naive: Naive, block: ElementTree.Element, key: str, entry: dict, where: str) -> None:
    if "body" in entry or "site" in entry:
        kind = "body" if "body" in entry else "site"
        return _add_frame(naive, block, key, kind, entry[kind], entry.get("quantity"), where)
    joint, type_ = joint_of(naive, entry.get("joint", key), where)
    if type_ == enums.FREE:
        body = naive.model.body(naive.model.joint(joint).bodyid[0]).name
        if not body:
            raise CaseError(f"{where}: the body of '{joint}' has no name in {naive.path.name}; give it a `name` there")
        return _add_frame(naive, block, key, "body", body, entry.get("quantity"), where)
    if type_ == enums.BALL:
        raise CaseError(f"{where}: '{joint}' is a ball joint; allowed: hinge, slide, free; measure its body instead")
    quantity = entry.get("quantity") or ("position" if span(entry["unit"]) else _by_unit(entry["unit"], where))
    if quantity not in ("position", "velocity"):
        raise CaseError(f"{where}.quantity is '{quantity}'; a joint has position or velocity; correct it")
    ElementTree.SubElement(block, "joint" + quantity[:3], {"name": key, "joint": joint})
    return None


def _by_unit(unit: str, where: str) -> str:
    positions = [(of, "position") for of in ("rad", "m", "counts", "percent")]
    for wanted, quantity in (*positions, ("rad/s", "velocity"), ("m/s", "velocity")):
        if same_dimension(unit, wanted):
            return quantity
    factor(unit, None, where)
    raise CaseError(
        f"{where}: from the unit '{unit}' it is not clear what is measured; add quantity: position or velocity"
    )


def _add_frame(naive: Naive, block, key: str, kind: str, name: str, quantity: str | None, where: str) -> None:
    one_of(naive.names(kind), name, kind, where)
    if quantity is None:
        raise CaseError(f"{where}.quantity is missing; {listed(FRAME, '')}; add it")
    tag = FRAME[quantity]
    if tag not in AT_SITE:
        objtype = "xbody" if kind == "body" else "site"
        ElementTree.SubElement(block, tag, {"name": key, "objtype": objtype, "objname": name})
        return
    if kind == "body":
        ElementTree.SubElement(body_element(naive, name, where), "site", {"name": f"{key} site"})
        name = f"{key} site"
    ElementTree.SubElement(block, tag, {"name": key, "site": name})
