"""Process-wide settings of JAX, for the half of fimpact that plans experiments; diagnosis does not use JAX.

`fimpact.paper.mjx.engine` calls `configure`, and every module that computes with JAX imports that one first.
`import fimpact` alone sets nothing.
"""

import hashlib
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

FORBIDDEN_JAX = "0.10.2"  # silently wrong vmapped matrix-vector sums from 16,385 rows on CPU (jax#39103)


def configure() -> None:
    """Select float64, one thread per process and a compile cache keyed by CPU and jax version.

    XLA ignores OMP variables and obeys `NPROC`; one thread per process lets Snakemake run one job per core.
    The cache only saves time: deleting it, or setting `FIMPACT_CACHE` to another folder, changes no result.
    """
    if version("jax") == FORBIDDEN_JAX:
        raise RuntimeError(f"jax {FORBIDDEN_JAX} miscomputes on CPU (jax#39103); install with -c constraints.txt")
    os.environ.setdefault("NPROC", "1")  # XLA reads it when it makes its first device, not when jax is imported
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    os.environ["JAX_ENABLE_X64"] = "1"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")
    if "jax" in sys.modules:  # it has read its environment already
        config = sys.modules["jax"].config
        config.update("jax_enable_x64", True)
        config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        seconds = float(os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"])
        config.update("jax_persistent_cache_min_compile_time_secs", seconds)


def cache_folder() -> Path:
    """Folder of compiled programs for this CPU and jax version; created by jax on first use."""
    root = os.environ.get("FIMPACT_CACHE") or Path.home() / ".cache" / "fimpact"
    return Path(root) / hashlib.sha256(f"{processor()} jax-{version('jax')}".encode()).hexdigest()[:12]


def processor() -> str:
    """Describe this processor and its instruction set: what is compiled for another's is rejected, or worse."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    flags = [line for line in lines if line.startswith(("model name", "flags", "Features"))]
    return platform.machine() + "".join(sorted(set(flags)))
