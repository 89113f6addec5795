"""What every result can do: summary, HTML, dictionary, save and load."""

import json
import re
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import iwanjax as ij
from iwanjax.errors import InputError
from iwanjax.results import AbstractResult, with_std
from iwanjax.signals import Channel
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape
from iwanjax.updating import Exponents


class Engine(eqx.Module):
    """A model: it computes."""

    K: jax.Array


class Errors(NamedTuple):
    fit: float
    hold_out: float


@dataclass(frozen=True, eq=False)
class Found(AbstractResult):
    force: float
    force_std: float
    omega: np.ndarray
    good: np.ndarray
    response: np.ndarray
    converged: bool
    labels: tuple[str, ...]
    shares: dict[str, float]
    errors: Errors
    rivals: tuple[str, ...]
    missing: np.ndarray | None
    outcome: ij.Result
    curves: ij.ModalCurves
    engine: Engine
    name: str = ""
    hidden: float = field(default=1.0, repr=False)

    _units: ClassVar = {"force": "N"}


def curves(**changes):
    values: dict[str, Any] = {
        "amplitude": jnp.array([1.0, 2.0, 4.0]),
        "frequency": jnp.array([12.0, 11.5, 11.0]),
        "damping": jnp.array([0.01, jnp.nan, 0.03]),
        "frequency_std": jnp.array([0.1, 0.2, 0.3]),
        "quantity": "velocity",
        "unit": "mm/s",
    }
    return ij.ModalCurves(**values | changes)


def found(**changes):
    values: dict[str, Any] = {
        "force": 12.345678,
        "force_std": 0.25,
        "omega": np.array([[1.0, 2.0], [3.0, np.inf]]),
        "good": np.array([True, False, True]),
        "response": np.array([3.0 + 4.0j, 0.0]),
        "converged": True,
        "labels": ("J1", "J2"),
        "shares": {"J1": 0.25},
        "errors": Errors(0.1, np.nan),
        "rivals": (),
        "missing": None,
        "outcome": ij.Result.LOST_MODE,
        "curves": curves(),
        "engine": Engine(jnp.eye(2)),
    }
    return Found(**values | changes)


# --- summary and HTML ---------------------------------------------------------------------


def rows(result):
    """Cells of the summary's lines by the first one."""
    lines = (re.split(r" {2,}", line.strip()) for line in result.summary().splitlines())
    return {first: rest for first, *rest in lines}


@pytest.mark.parametrize(
    ("name", "cells"),
    [
        ("force", ["12.3457", "0.25", "N"]),
        ("omega", ["1 to 3, 1 nan", "rad/s", "2 x 2"]),
        ("good", ["2 of 3", "3"]),
        ("response", ["0 to 5", "2"]),
        ("converged", ["yes"]),
        ("labels", ["J1, J2"]),
        ("shares: J1", ["0.25"]),
        ("errors: fit", ["0.1"]),
        ("errors: hold_out", ["nan"]),
        ("outcome", ["LOST_MODE"]),
        ("curves.amplitude", ["1 to 4", "mm/s", "3"]),
        ("curves.frequency", ["11 to 12", "0.2", "Hz", "3"]),
        ("curves.damping", ["0.01 to 0.03, 1 nan", "1", "3"]),
        ("engine", ["Engine"]),
    ],
)
def test_a_line_tells_value_deviation_unit_and_size(name, cells):
    assert rows(found())[name] == cells


def test_deviations_what_is_unknown_and_what_is_hidden_have_no_line():
    assert not {"force_std", "missing", "rivals", "hidden", "curves.frequency_std", "name"} & set(
        rows(found())
    )


def test_a_name_stands_at_the_top():
    assert found(name="beam").summary().splitlines()[0] == "Found: beam"
    assert found().summary().splitlines()[0] == "Found"


def test_columns_are_aligned():
    lines = found().summary().splitlines()[2:]
    where = lines[0].index("unit")
    assert all(line[where - 1 : where] in ("", " ") for line in lines)
    assert lines[1][where] == "N"


def test_html_says_the_same_and_nothing_of_colours():
    result = found(labels=("<b>", "J&2"))
    shown = result._repr_html_()
    cells = re.findall(r"<td[^>]*>(.*?)</td>", shown)
    assert "&lt;b&gt;, J&amp;2" in cells
    assert {"12.3457", "0.25", "N", "LOST_MODE"} <= set(cells)
    assert shown.count("<tr>") == len(re.findall(r"^  ", result.summary(), re.MULTILINE))
    styles = " ".join(re.findall(r'style="(.*?)"', shown))
    assert "background" not in styles
    assert set(re.findall(r"[\w-]*color:[^;]*|#\w+|rgb", styles)) == set()
    assert "currentColor" in styles


def test_empty_text_numbers_without_any_and_shapes_of_batches():
    batch = curves(
        amplitude=np.ones((2, 3)), frequency=np.full((2, 3), np.nan), damping=np.ones((2, 3)),
        frequency_std=None, unit="",
    )  # fmt: skip
    told = rows(batch)
    assert told["frequency"] == ["nan", "Hz", "2 x 3"]
    assert "unit" not in told


def test_a_value_has_the_digits_that_its_deviation_leaves():
    assert with_std(117.99987, 0.0012) == "117.9999 ± 0.0012"
    assert with_std(2.0, 3.0) == "2 ± 3"
    assert with_std(2.0, np.inf) == with_std(2.0, 0.0) == "2"


# --- dictionary ---------------------------------------------------------------------------


def test_a_dictionary_has_plain_values_and_no_models():
    told = found().to_dict()
    assert "engine" not in told
    assert told["force"] == 12.345678
    assert told["labels"] == ["J1", "J2"]
    assert told["outcome"] == "lost_mode"
    assert told["errors"]["fit"] == 0.1
    assert told["missing"] is None
    assert type(told["curves"]["amplitude"]) is np.ndarray
    np.testing.assert_array_equal(told["curves"]["frequency"], [12.0, 11.5, 11.0])
    assert told["curves"]["quantity"] == "velocity"
    del told["response"]
    again = json.loads(json.dumps(told, default=np.ndarray.tolist))
    assert again["curves"]["amplitude"] == [1.0, 2.0, 4.0]


# --- save and load ------------------------------------------------------------------------


def chain():
    structure = ij.LinearStructure(
        np.eye(3), None, [[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    )
    joint = ij.Iwan4(F_S=10.0, K_T=1.0, chi=-0.5, beta=5.0)
    return ij.JointedStructure(structure, {"J1": (np.array([0.0, -1.0, 1.0]), joint)})


def recording():
    t = np.arange(64) / 64.0
    channel = Channel("a1", "acceleration", "m/s^2", "+x")
    return ij.Recording(t, np.sin(9.0 * t)[:, None], (channel,), name="hit")


def merged():
    falling = [
        curves(
            amplitude=np.geomspace(4.0, 0.1 * (i + 1), 20),
            frequency=np.linspace(11.0, 12.0, 20),
            damping=np.linspace(0.03, 0.01, 20),
            frequency_std=np.full(20, 1e-3),
            damping_std=np.full(20, 1e-4),
        )
        for i in range(3)
    ]
    return ij.merge_curves(falling)


def reduced():
    shape = SurfaceShape(np.zeros((4, 3)), np.array([[0, 1, 2, 3]]), np.array([-1]), np.zeros(2))
    row = {"J1.x": np.array([1.0, 0.0])}
    return ReducedModel(
        np.eye(2), np.eye(2), ("J1A.x",), row, row, row, shape, np.array([5.0]), np.zeros((1, 6)),
        {"hammer": 0.5},
    )  # fmt: skip


RESULTS = {
    "ModalCurves": curves,
    "QsmaSolution": lambda: ij.qsma(chain(), [0, 1], [0.1, 1.0], 1e-3),
    "CoupledModes": lambda: ij.coupled_modes(chain(), [[1.0, 0.5]], 1e-3, cycles=5, sliders=8),
    "Recording": recording,
    "MergedCurves": merged,
    "ForceLoop": lambda: ij.signals.ForceLoop(np.arange(9.0), np.arange(9.0) ** 2, "rig"),
    "MeasuredModes": lambda: ij.MeasuredModes([10.0, 20.0], 0.1),
    "Exponents": lambda: Exponents((0.5, 0.1), (0.6, 0.1), (1.0, 0.1), (1e-3, 1e-4), 0.1, 0.1),
    "ReducedModel": reduced,
    "Found": found,
}


def same(a, b):
    """Equal in all they hold, classes and kinds of arrays included."""
    assert type(a) is type(b)
    if isinstance(a, np.ndarray | jax.Array):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype
    elif isinstance(a, tuple | list):
        for x, y in zip(a, b, strict=True):
            same(x, y)
    elif isinstance(a, dict):
        assert list(a) == list(b)
        same([*a.values()], [*b.values()])
    elif hasattr(a, "__dataclass_fields__"):
        for each in fields(a):
            same(getattr(a, each.name), getattr(b, each.name))
    else:
        assert a == b or (a != a and b != b)


@pytest.mark.parametrize("name", RESULTS)
def test_what_is_loaded_is_what_was_saved(name, tmp_path):
    result = RESULTS[name]()
    assert type(result).__name__ == name
    path = result.save(tmp_path / "result.npz")
    loaded = type(result).load(path)
    same(result, loaded)
    assert loaded.summary() == result.summary()
    assert loaded._repr_html_() == result._repr_html_()
    assert [each.name for each in tmp_path.iterdir()] == ["result.npz"]


def test_a_loaded_result_computes_as_before(tmp_path):
    solution = RESULTS["QsmaSolution"]()
    loaded = ij.QsmaSolution.load(solution.save(tmp_path / "qsma.npz"))
    np.testing.assert_array_equal(loaded.participation, solution.participation)
    again = ij.qsma(loaded.structure, 0, [0.1, 1.0], 1e-3)
    np.testing.assert_array_equal(again.q, solution.q[0])
    assert jax.tree.structure(loaded) == jax.tree.structure(solution)


def test_a_recordings_arrays_stay_read_only(tmp_path):
    original = recording()
    loaded = ij.Recording.load(original.save(tmp_path / "hit.npz"))
    assert not original.response.flags.writeable
    assert not loaded.response.flags.writeable


def test_any_class_of_result_loads_by_the_base(tmp_path):
    assert isinstance(AbstractResult.load(curves().save(tmp_path / "c.npz")), ij.ModalCurves)


def test_another_class_of_result_is_refused(tmp_path):
    path = curves().save(tmp_path / "c.npz")
    with pytest.raises(InputError, match="holds a ModalCurves; expected Recording"):
        ij.Recording.load(path)


def test_what_no_file_can_hold_is_named_with_its_place(tmp_path):
    with pytest.raises(InputError, match=r"Found\.shares\.J1 is a function"):
        replace(found(), shares={"J1": chain}).save(tmp_path / "f.npz")
    assert not list(tmp_path.iterdir())


# --- plot ---------------------------------------------------------------------------------


def test_plot_is_the_packages():
    assert isinstance(curves().plot(), Figure)
    with pytest.raises(InputError, match="no figure for a ForceLoop"):
        RESULTS["ForceLoop"]().plot()
