"""MJX, imported in one place: it prints two lines when its optional Warp backend is absent, in every process."""

import io
from contextlib import redirect_stdout

with redirect_stdout(io.StringIO()):
    from mujoco import mjx
    from mujoco.mjx._src import smooth, support

__all__ = ["mjx", "smooth", "support"]
