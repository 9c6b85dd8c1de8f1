"""Effects of one's own, from a Python file that adds them to the catalogue.

Only whoever types the command names that file; a case cannot, because a case that someone else wrote must not run code.
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from unittest.mock import patch

from fimpact.effects import EFFECTS
from fimpact.effects.base import Effect


def load_effects(path: Path | str) -> list[str]:
    """Run the Python file at `path`; what it puts into `EFFECTS` takes part in every diagnosis of this process.

    Returns:
        The names that it added.

    Raises:
        ValueError: it cannot be run, or adds nothing; the catalogue is then as it was.
    """
    path, before = Path(path), dict(EFFECTS)
    if not path.is_file():
        raise ValueError(f"{path} is not a file; name the Python file that adds effects to fimpact.effects.EFFECTS")
    try:
        _run(path)
        added = _added(before)
    except (Exception, SystemExit) as error:  # whatever the file does wrong is its author's to mend, and gets one line
        EFFECTS.clear()
        EFFECTS.update(before)
        raise ValueError(f"{path}: {_said(error)}; run it with python to see where") from None
    if not added:
        raise ValueError(
            f"{path} adds no effect; end it with EFFECTS[effect.name] = effect, an Effect of fimpact.effects.base"
        )
    return added


def _said(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        return "it ends the program (exit); it may only define effects"
    return f"{type(error).__name__}: {error}"


def _run(path: Path) -> None:
    # Under fimpact's own name, so that an exported model takes the source of its functions along.
    name = f"fimpact.effects.plugins.{path.stem}"
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError("not a Python file; its name must end in .py")
    module = sys.modules[name] = module_from_spec(spec)
    with patch.object(sys, "dont_write_bytecode", True):  # no cache is left beside somebody's file
        spec.loader.exec_module(module)


def _added(before: dict[str, Effect]) -> list[str]:
    new = {name: effect for name, effect in EFFECTS.items() if name not in before or effect is not before[name]}
    for name, effect in new.items():
        if not isinstance(effect, Effect) or effect.name != name:
            raise TypeError(f"EFFECTS[{name!r}] must be an Effect of that name, and is {effect!r:.60}")
    return list(new)
