import importlib.metadata
import importlib.resources
import os
import subprocess
import sys

import pytest

import iwanjax

PROBE = """
import sys
import jax
before = jax.config.jax_enable_x64
import iwanjax
heavy = {"matplotlib", "emcee", "jaxopt", "scipy.sparse", "skfem"} & set(sys.modules)
print(before, jax.config.jax_enable_x64, *sorted(heavy))
"""


@pytest.mark.parametrize("x64", ["False", "True"])
def test_import_is_light_and_leaves_the_precision_alone(x64):
    """Checked in a fresh process, since this one has long imported everything."""
    run = subprocess.run(
        [sys.executable, "-c", PROBE],
        env={**os.environ, "JAX_ENABLE_X64": x64},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split() == [x64, x64]


def test_version_is_the_installed_one():
    try:
        installed = importlib.metadata.version("iwanjax")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("iwanjax runs from its sources and is not installed")
    assert iwanjax.__version__ == installed


def test_type_checkers_are_told_that_it_is_typed():
    """PEP 561: without the marker they take every name of the package for Any."""
    assert (importlib.resources.files(iwanjax) / "py.typed").is_file()
