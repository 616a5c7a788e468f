"""JAX as it must be configured, in this process and in a fresh one."""

import os
import subprocess
import sys

import numpy as np
import pytest

from rovtwin.core.numerics import (
    _add_flag,
    as_array,
    cache_folder,
    jax,
    jnp,
    module_for,
    unoptimised,
)
from rovtwin.core.programs.compiled import in_one_piece, jit_once


def test_double_precision():
    assert jnp.zeros(1).dtype == np.float64
    assert jnp.asarray(1.0).dtype == np.float64
    assert float(jnp.asarray(1.0) + 1e-15) != 1.0


def test_as_array_makes_numbers_differentiable():
    for value in (1, 1.0, [1, 2], ((1, 2), (3, 4)), np.arange(3), np.float32(1)):
        array = as_array(value)
        assert array.dtype == np.float64 and array.shape == np.shape(value)
    assert float(jax.grad(lambda x: as_array(x) ** 2)(3.0)) == 6.0


def test_cache_folder_can_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv("ROVTWIN_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("ROVTWIN_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "rovtwin"


@pytest.mark.system
def test_fresh_process_is_configured_before_jax_starts(tmp_path):
    """XLA reads its flags once: importing any module that computes must be enough, and what is compiled is kept."""
    script = """
import os
from rovtwin.vehicle.physics import dynamics
import jax
print(jax.config.jax_enable_x64, jax.config.read("jax_cpu_enable_async_dispatch"), os.environ["PJRT_NPROC"])
print(os.environ.get("XLA_FLAGS", ""))
print(jax.config.jax_compilation_cache_dir)
"""
    environment = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", "PJRT_NPROC")}
    environment |= {"ROVTWIN_CACHE": str(tmp_path), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    settings, flags, folder = done.stdout.splitlines()
    assert settings == "True False 1"
    assert ("xla_cpu_small_while_loop_byte_threshold" in flags) == (sys.version_info < (3, 12))
    assert folder.startswith(str(tmp_path))


def test_what_a_user_sets_in_xla_flags_stands(monkeypatch):
    for own, added in (("", True), ("--xla_cpu_prefer_vector_width=256", False), ("--xla_dump_to=x", True)):
        monkeypatch.setenv("XLA_FLAGS", own)
        _add_flag("--", "xla_cpu_prefer_vector_width", "512")
        flags = os.environ["XLA_FLAGS"].split()
        assert [f for f in flags if f != "--xla_cpu_prefer_vector_width=512"] == own.split()
        assert ("--xla_cpu_prefer_vector_width=512" in flags) == added


def test_parameters_are_computed_by_numpy_unless_they_are_under_a_trace():
    assert module_for(1.0, {"a": [jnp.ones(2), np.ones(2)]}) is np
    seen = []
    jax.jit(lambda x: seen.append(module_for(1.0, [x])) or x)(1.0)
    assert seen == [jnp]


def test_in_one_piece_gives_what_jit_gives():
    def function(tree, x):
        return {"sum": tree["a"] @ x, "sign": jnp.sign(x).astype(int)}, jnp.linalg.norm(x)

    arguments = {"a": jnp.arange(9.0).reshape(3, 3)}, jnp.array([1.0, -2.0, 0.5])
    one, other = in_one_piece(function)(*arguments), jax.jit(function)(*arguments)
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)


def test_in_one_piece_takes_static_arguments_by_name_and_uses_up_what_is_given_away():
    def function(x, y, *, times):
        return jax.lax.scan(lambda c, _: (c + y, c), x, length=times)

    whole = in_one_piece(function, quickly=True, static_argnames="times", donate_argnames="x")
    for times in (3, 5):
        given = jnp.zeros(2)
        last, before = whole(given, jnp.ones(2), times=times)
        np.testing.assert_array_equal(last, [times, times])
        assert before.shape == (times, 2) and given.is_deleted()


def test_what_is_compiled_once_is_not_optimised_unless_the_user_says_how(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    plain = {"xla_backend_optimization_level": 0}
    found = unoptimised()
    assert found is not None and plain.items() <= found.items()
    np.testing.assert_allclose(jit_once(lambda x, n: x**n, static_argnames="n")(jnp.arange(3.0), n=2), [0.0, 1.0, 4.0])
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=2")
    assert unoptimised() is None


def test_what_cannot_be_in_one_piece_is_compiled_as_it_is(caplog):
    with caplog.at_level("DEBUG", "rovtwin"):
        one = in_one_piece(jnp.linalg.cholesky)(4.0 * jnp.eye(3))
    np.testing.assert_allclose(one, 2.0 * np.eye(3))
    assert "not in one piece" in caplog.text


def test_arrays_of_other_types():
    assert as_array([True, False], bool).dtype == bool and as_array(3, int).dtype == jnp.int64
