"""What MuJoCo does beside simulating, and nobody here wants: warnings, a log file, and a profiler."""

import ctypes
from pathlib import Path

import mujoco


def hush() -> None:
    """Simulate and do nothing else, in this process.

    A trial step that diverges is an infinite cost; MuJoCo would print it and write a log file. Its profiler asks the
    clock all through a step, which where clocks are slow takes up to a third of the time of small models. In C it is
    off until `mjcb_time` is set; the Python bindings set it, and leave no way back but the symbol itself.
    """
    mujoco.set_mju_user_warning(lambda message: None)
    clock().value = None


def clock() -> ctypes.c_void_p:
    """Address of what the profiler asks for the time, to be written; of no consequence where it is not found."""
    try:
        return ctypes.c_void_p.in_dll(ctypes.CDLL(library_path()), "mjcb_time")
    except (OSError, ValueError):
        return ctypes.c_void_p()


def library_path() -> str:
    """Find the path of the library that the bindings have loaded; "" is none."""
    found = sorted(Path(mujoco.__file__).parent.glob("*mujoco*.*"))
    return next((str(path) for path in found if path.suffix in (".dll", ".dylib") or ".so" in path.suffixes), "")
