"""What MuJoCo does beside simulating, and nobody here wants: warnings, a log file, and a profiler."""

import contextlib
import ctypes
from pathlib import Path

import mujoco


def hush() -> None:
    """Simulate and do nothing else, in this process.

    A trial step that diverges is an infinite cost; MuJoCo would print it and write a log file. Its profiler asks the
    clock all through a step, which where clocks are slow takes up to a third of the time of small models. In C it is
    off until `mjcb_time` is set; the Python bindings set it, and leave no way back but the symbol itself. Where that
    is not found, it stays on.
    """
    mujoco.set_mju_user_warning(lambda message: None)
    with contextlib.suppress(OSError, ValueError):
        ctypes.c_void_p.in_dll(ctypes.CDLL(_library()), "mjcb_time").value = None


def _library() -> str:
    """Path of the library that the bindings have loaded; "" is none."""
    found = sorted(Path(mujoco.__file__).parent.glob("*mujoco*.*"))
    return next((str(path) for path in found if path.suffix in (".dll", ".dylib") or ".so" in path.suffixes), "")
