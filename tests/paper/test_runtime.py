"""The numerical ground: float64, and a jax that adds up."""

import re

import jax
import jax.numpy as jnp
import numpy as np
from conftest import ROOT

from fimpact.paper.mjx import runtime


def test_float64_and_no_forbidden_jax():
    assert jnp.zeros(1).dtype == jnp.float64
    assert jax.__version__ != runtime.FORBIDDEN_JAX


def test_jax_is_set_up_before_it_is_imported():
    for path in (ROOT / "src").rglob("*.py"):
        text = path.read_text()
        if re.search(r"^import jax\b", text, re.M):
            assert re.search(r"^(from|import) fimpact\.paper\.mjx\.engine\b.*?^import jax\b", text, re.M | re.S), (
                path.name
            )


def test_vmapped_products_are_right_at_16385_rows():
    # jax 0.10.2 gets this wrong on CPU (jax#39103).
    rng = np.random.default_rng(0)
    matrix, rows = rng.normal(size=(7, 5)), rng.normal(size=(16_385, 5))
    ours = jax.jit(jax.vmap(lambda row: (matrix @ row).sum()))(rows)
    assert np.allclose(ours, (rows @ matrix.T).sum(1), rtol=1e-12, atol=1e-12)


def test_the_cache_is_keyed_by_cpu_and_jax(monkeypatch, tmp_path):
    monkeypatch.setenv("FIMPACT_CACHE", str(tmp_path))
    first = runtime.cache_folder()
    monkeypatch.setattr(runtime, "processor", lambda: "another")
    assert runtime.cache_folder().parent == tmp_path
    assert runtime.cache_folder() != first
