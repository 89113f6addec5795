"""Every notebook runs to its last assertion, and is stored without what running adds."""

import re
import warnings
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="notebooks extra not installed")
nbclient = pytest.importorskip("nbclient", reason="notebooks extra not installed")
pytest.importorskip("ipykernel", reason="notebooks extra not installed")

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
# Seconds after which a cell is taken to hang; of a long notebook on a processor that others use.
LIMIT, LIMIT_LONG = 300, 1800
# Half a minute or more each, of studies whose parts and numbers other tests check.
LONG = (
    "03_frequency_and_damping_of_three_masses",
    "04_when_modes_share_a_joint",
    "05_static_and_kinetic_friction",
    "06_what_is_missing",
    "07_brake_reuss_beam",
    "08_sumali_beam",
    "09_silverbox",
    "12_a_force_without_a_name",
    "13_do_two_modes_near_one_to_two_act_on_each_other",
    "14_how_much_of_a_friction_damper_is_a_law",
    "15_from_hammer_to_prediction",
)


def read(path):
    return nbformat.read(path, as_version=4)


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_stored_without_outputs(path):
    notebook = read(path)
    nbformat.validate(notebook)
    assert notebook.metadata.kernelspec.name == "python3"
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    assert 'jax.config.update("jax_enable_x64", True)' in code[0].source
    assert code[-1].source.splitlines()[-1].startswith("assert ")


def source_of(path):
    return "\n".join(cell.source for cell in read(path).cells)


def sizes():
    """Notebooks as they run by default, and in full where they have another size for that."""
    for path in NOTEBOOKS:
        marks = pytest.mark.long if path.stem in LONG else ()
        yield pytest.param(path, False, marks=marks, id=path.stem)
        if "IWANJAX_LONG" in source_of(path):
            yield pytest.param(path, True, marks=pytest.mark.long, id=f"{path.stem} in full")


@pytest.mark.parametrize(("path", "full"), list(sizes()))
def test_it_runs(path, full, request, monkeypatch):
    source = source_of(path)
    if not full:
        monkeypatch.delenv("IWANJAX_LONG", raising=False)
    if "iwanjax.structures.fem" in source:
        pytest.importorskip("skfem", reason="scikit-fem (extra fem) is not installed")
    for name in re.findall(r'\bdata / "(\w+)"', source):
        folder = request.getfixturevalue("reference_data") / name
        if not folder.is_dir():
            pytest.skip(f"no {folder}")
    # The kernel is a process of its own: only its client's warnings, about sockets and event
    # loops, arrive here, and they say nothing about the notebook.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        client = nbclient.NotebookClient(
            read(path),
            timeout=LIMIT_LONG if path.stem in LONG else LIMIT,
            kernel_name="python3",
            resources={"metadata": {"path": str(FOLDER)}},
        )
        notebook = client.execute()
    for cell in notebook.cells:
        if "figure = " in cell.source:
            assert sum("image/png" in output.get("data", {}) for output in cell.outputs) == 1
