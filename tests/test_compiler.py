import importlib.util
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import ModuleType

import jax
import pytest

from iwanjax import compiler

FLAG = "--xla_cpu_use_fusion_emitters=false"
LOOP = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
PRODUCTS = "--xla_cpu_experimental_ynn_fusion_type="
ALL = f"{FLAG} {LOOP} {PRODUCTS}"


@pytest.fixture
def flags(monkeypatch):
    """XLA_FLAGS after asking, for a version of jaxlib and what was in it before."""

    def after(jaxlib: str, before: str | None) -> str | None:
        monkeypatch.setattr(compiler, "version", lambda _: jaxlib)
        monkeypatch.delenv("XLA_FLAGS", raising=False)
        if before is not None:
            monkeypatch.setenv("XLA_FLAGS", before)
        compiler.compile_quickly()
        return os.environ.get("XLA_FLAGS")

    return after


def test_a_flag_is_added_where_it_is_known(flags):
    assert flags("0.10.2", None) == ALL
    assert flags("0.10.0", "--xla_some=1") == f"--xla_some=1 {ALL}"
    # An unknown flag stops the process.
    assert flags("0.12.0.1", None) is None
    assert flags("1.0", "--xla_some=1") == "--xla_some=1"


def test_what_the_user_has_set_stays(flags):
    other = FLAG.replace("false", "true")
    assert flags("0.10.2", other) == f"{other} {LOOP} {PRODUCTS}"
    assert flags("0.10.2", ALL) == ALL


def test_xla_takes_it_and_loops_are_in_one_piece():
    code = """
import os, iwanjax; iwanjax.compile_quickly()
import jax, jax.numpy as jnp
def step(x, u): return jnp.tanh(A @ x) + u, x[0]
A = 0.5 * jnp.eye(8)
run = jax.jit(lambda x, u: jax.lax.scan(step, x, u)).lower(A, jnp.ones(3000)).compile()
quickly = "while_loop" in os.environ.get("XLA_FLAGS", "")
assert "xla_cpu_small_call" in run.as_text() or not quickly, run.as_text()
assert jnp.isfinite(run(A, jnp.ones(3000))[0]).all()
"""
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


@pytest.fixture
def session():
    """The module as a new session has it, which nobody has been warned in."""

    def begin() -> ModuleType:
        spec = importlib.util.spec_from_file_location("compiler_of_a_session", compiler.__file__)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return begin


def test_slow_loops_are_said_once(monkeypatch, session):
    compiler = session()
    monkeypatch.setattr(compiler, "version", lambda _: "0.10.2")
    monkeypatch.setenv("XLA_FLAGS", "--xla_some=1")
    with pytest.warns(UserWarning, match=r"compile_quickly\(\) before the first computation"):
        compiler.warn_of_slow_loops()
    # Warnings are errors here: a second one would show.
    compiler.warn_of_slow_loops()
    for jaxlib, flags in (("0.10.2", ALL), ("0.12.0", "")):
        compiler = session()
        monkeypatch.setattr(compiler, "version", lambda _, v=jaxlib: v)
        monkeypatch.setenv("XLA_FLAGS", flags)
        compiler.warn_of_slow_loops()


def default_device():
    return jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]


def test_the_processor_is_the_default_for_all_threads_while_it_lasts():
    cpu = jax.local_devices(backend="cpu")[0]
    with ThreadPoolExecutor(1) as pool:
        for fails in (False, True):
            with suppress(ZeroDivisionError), compiler.on_the_processor():
                assert pool.submit(default_device).result() == cpu
                assert 1 // (not fails)
            assert default_device() is None


def test_without_a_processor_to_compute_on_the_default_stays(monkeypatch):
    def unknown(**_):
        raise RuntimeError("Unknown backend cpu")

    monkeypatch.setattr(jax, "local_devices", unknown)
    with compiler.on_the_processor():
        assert default_device() is None


def test_commands_leave_accelerators_alone_unless_told(tmp_path):
    """The platforms that JAX may use, by the environment and by default."""
    code = "import jax; from iwanjax import cli; cli._set_up(); print(jax.config.jax_platforms)"
    for told, expected in ((None, "cpu"), ("cuda,cpu", "cuda,cpu")):
        own = {k: v for k, v in os.environ.items() if k != "JAX_PLATFORMS"}
        own |= {"IWANJAX_CACHE": str(tmp_path)} | ({"JAX_PLATFORMS": told} if told else {})
        run = subprocess.run(
            [sys.executable, "-c", code], env=own, capture_output=True, text=True, check=True
        )
        assert run.stdout.split() == [expected]
