"""MJX, imported in one place once JAX is set up: it prints two lines when its optional Warp backend is absent."""

import io
from contextlib import redirect_stdout

from fimpact.paper.mjx.runtime import configure

configure()

with redirect_stdout(io.StringIO()):
    from mujoco import mjx
    from mujoco.mjx._src import smooth, support

__all__ = ["mjx", "smooth", "support"]
