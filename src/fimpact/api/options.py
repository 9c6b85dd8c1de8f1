"""Options that the command line and the API share."""

from fimpact.cases.errors import one_of
from fimpact.effects import EFFECTS


def chosen_family(only: str, where: str = "only") -> str:
    """The family of effects that is meant by its name or one word of it; "" is all of them.

    Args:
        where: how messages name the option.

    Raises:
        CaseError: no family is called so.
    """
    families = list(dict.fromkeys(effect.family for effect in EFFECTS.values()))
    alike = [family for family in families if only in family.split()]
    return alike[0] if len(alike) == 1 else only and one_of(families, only, "family", where)
