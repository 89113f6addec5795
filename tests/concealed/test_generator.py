"""The generator of concealed cases integrates and slips as the field's formulas say."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from concealed.cases import CASES, SIZES
from concealed.hammer import Hit, integrate
from concealed.modal import MODAL_CASES
from concealed.modal import write as write_modal
from concealed.plan import plan
from concealed.sizing import refusal
from concealed.structures import chain

from iwanjax.trial.effects import Effect
from iwanjax.trial.physics import JointBank, slider_bank


@pytest.mark.parametrize(
    "effect",
    [
        Effect("gap_contact", "m3-ground", (5.0e4, 3.0e-4, 2.0)),
        Effect("quadratic_damping", "m2-m3", (40.0,)),
        Effect("viscoelastic", "m1-ground", (2.0e4, 5.0e-3)),
        Effect("root_damper", "m3-ground", (13.0, 3e-4)),
        *(
            pytest.param(effect, marks=pytest.mark.long)
            for effect in (
                Effect("smooth_hysteresis", "m2-m3", (1.1e5, 8e-5, 1.7)),
                Effect("bristles", "m2-m3", (1.4e5, 0.0, 6.0, 5.0, 8.0, 0.02)),
                Effect("rubbing_freeplay", "m3-ground", (4e4, 3.5e-4, 2.0)),
            )
        ),
    ],
    ids=lambda effect: effect.kind,
)
def test_halving_the_step_changes_nothing(effect):
    structure = replace(chain(3), samples=1024)
    hits = [Hit("m1", 90.0, 45.0, 11.0, "fit", 0), Hit("m3", 30.0, 50.0, 9.0, "fit", 1)]
    coarse, fine = (
        integrate(structure, structure.joints, [effect], hits, oversampling).response[
            ::oversampling
        ]
        for oversampling in (16, 32)
    )
    change = np.sqrt(np.mean((coarse - fine) ** 2) / np.mean(fine**2))
    assert change < 3e-4


@pytest.mark.parametrize(("chi", "beta"), [(-0.5, 2.0), (-0.3, 0.5), (-0.7, 5.0)])
@pytest.mark.parametrize("s", [0.03, 0.2, 0.8])
def test_slider_bank_dissipates_as_segalman_says(chi, beta, s):
    F_S, K_T = 20.0, 5.0e4
    phi_max = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    slip, stiffness = slider_bank(*np.array([[[F_S]], [[K_T]], [[chi]], [[beta]]]))
    bank = JointBank(slip, stiffness, np.ones((1, 1)))
    path = s * phi_max * np.sin(np.linspace(0.0, 5 * np.pi, 4001))
    force = np.array([bank.force(np.array([[d]]))[0, 0] for d in path])
    cycle = slice(800, 2401)
    dissipated = np.trapezoid(force[cycle], path[cycle])
    law = 4 * K_T * phi_max**2 * (chi + 1) / ((1 + beta) * (chi + 2) * (chi + 3)) * s ** (chi + 3)
    assert dissipated == pytest.approx(law, rel=0.02)


def test_the_generator_shares_nothing_with_what_it_tries():
    for source in Path(__file__).parent.glob("*.py"):
        names = set()
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(node.module or "")
        # `iwanjax.trial` imports nothing of the package (test_layering.py). Beside it only the mesh
        # behind one structure's matrices is used.
        shared = {n for n in names if n.split(".")[0] in ("iwanjax", "numba", "jax")}
        others = {n for n in shared if not n.startswith("iwanjax.trial")}
        assert (not others) != (source.name == "brake_reuss.py"), (source.name, others)


def test_what_does_not_show_as_it_should_or_runs_away_is_no_case():
    case = next(c for c in plan() if [w[::2] for w in c.wanted] == [("cubic_stiffness", "medium")])
    hardening, softening = ((1e4,), 0.2), ((-1e15,), 0.2)
    assert refusal(case, [hardening]) is None
    assert "0.010 at most" in (refusal(case, [((1e4,), 0.01)]) or "")
    assert "runs away" in (refusal(case, [softening]) or "")


def test_refused_cases_are_left_out():
    refused = {
        int(n) for n, found in json.loads(SIZES.read_text()).items() if isinstance(found, str)
    }
    numbers = {case.number for case in CASES}
    assert refused
    assert not refused & numbers
    assert refused | numbers == {case.number for case in plan()}


@pytest.mark.long
def test_a_structure_that_is_thrown_rings_in_the_modes_it_was_thrown_in(tmp_path):
    for kind, both in (("none", False), ("modal_coupling", True)):
        case = next(c for c in MODAL_CASES if c.kind == kind and c.structure.name == "chain3")
        write_modal(case, tmp_path / kind)
        study = yaml.safe_load((tmp_path / kind / "study.yaml").read_text())
        bands = [mode["band"] for mode in study["model"]["modal"]]
        recording = study["recordings"][0]
        assert recording["modes"] == case.names[: 2 if both else 1]
        signal = np.load(tmp_path / kind / recording["file"])["response"][:, 0]
        spectrum = np.abs(np.fft.rfft(signal)) ** 2
        f = np.fft.rfftfreq(len(signal), 1.0 / case.structure.rate)
        shares = [np.sum(spectrum[(f > low) & (f < high)]) for low, high in bands]
        assert bool(min(shares) > 1e-3 * max(shares)) is both
        assert sum(shares) > 0.95 * np.sum(spectrum)
        truth = json.loads((tmp_path / kind / "truth.json").read_text())
        assert truth["modes"] == dict.fromkeys(case.names, kind)
