import os
import subprocess
import sys

import pytest

from iwanjax import compiler

FLAG = "--xla_cpu_use_fusion_emitters=false"


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
    assert flags("0.10.2", None) == FLAG
    assert flags("0.10.0", "--xla_some=1") == f"--xla_some=1 {FLAG}"
    # An unknown flag stops the process.
    assert flags("0.12.0.1", None) is None
    assert flags("1.0", "--xla_some=1") == "--xla_some=1"


def test_what_the_user_has_set_stays(flags):
    assert flags("0.10.2", FLAG.replace("false", "true")) == FLAG.replace("false", "true")


def test_xla_takes_it():
    code = (
        "import iwanjax, iwanjax.compiler as c; c.compile_quickly();"
        "import jax.numpy as jnp; assert jnp.sin(0.0) == 0.0"
    )
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
