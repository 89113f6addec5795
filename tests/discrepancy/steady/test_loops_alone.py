"""Loops of joints without a structure, with time, and with the scatter of their cycles."""

from pathlib import Path

import numpy as np
import pytest

import iwanjax as ij
from iwanjax.config.study import read_study
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.joints import JOINTS
from iwanjax.signals import ForceLoop

DT = 0.01
T = DT * np.arange(1200)
JENKINS = JOINTS["jenkins"](F_S=1.0, K_T=2.0)
CONFIG = Path(__file__).parents[3] / "configs" / "friction_damper.yaml"


def cycles(amplitude, seconds=3.0):
    return amplitude * np.sin(2.0 * np.pi * T / seconds)


def test_the_scatter_is_that_between_cycles():
    random = np.random.default_rng(4)
    d = cycles(2.0)
    force = np.asarray(ij.hysteresis(JENKINS, d)) + 0.5 * np.sin(9.0 * d)
    # Each quarter of a cycle is stronger or weaker by 0.1.
    drifts = np.interp(T, np.arange(0.0, 12.1, 0.75), 0.1 * random.standard_normal(17))
    loop = ForceLoop(d[75:], (force + drifts)[75:])
    assert ForceLoop(d[75:], force[75:]).scatter < 0.02
    assert loop.scatter == pytest.approx(0.1, rel=0.35)
    assert loop.noise < 0.3 * loop.scatter
    assert np.isnan(ForceLoop(d[:100], force[:100]).scatter)


def test_partial_loops_do_not_count_as_scatter():
    small, large = cycles(0.5), cycles(2.0)
    d = np.concatenate([small, large])
    assert ForceLoop(d, np.asarray(ij.hysteresis(JENKINS, d))).scatter < 0.02


def test_loops_with_time_show_a_dashpot():
    """At half the rate it has half the force."""
    random = np.random.default_rng(7)
    loops = []
    for seconds in (3.0, 6.0):
        d = cycles(2.0, seconds)
        force = np.asarray(ij.hysteresis(JENKINS, d)) + 0.1 * np.gradient(d, DT)
        force = force + 0.01 * random.standard_normal(d.size)
        loops.append(ForceLoop(d, force, f"{seconds:g} s", DT))
    found = diagnose_loops(JENKINS, loops, hypotheses=("viscous_damping",), starts=4)
    (effect,) = found.what
    assert effect.kind.name == "viscous_damping"
    value = effect.parameters[0]
    assert abs(value.value - 0.1) < 4.0 * value.std
    assert not any("cannot show" in each for each in found.warnings)


def test_joints_alone_are_a_model_for_loops(tmp_path):
    d = cycles(2.0)
    np.savez(tmp_path / "loop.npz", time=T, stroke=d, load=np.asarray(ij.hysteresis(JENKINS, d)))
    text = (
        "name: alone\n"
        "model: {joints: [{name: J1, type: jenkins, parameters: {F_S: 1.0, K_T: 2.0}}]}\n"
        "recordings:\n  - {file: loop.npz, kind: loop, response: {channel: stroke},"
        " force: {array: load}}\n"
    )
    (tmp_path / "study.yaml").write_text(text)
    study = read_study(tmp_path / "study.yaml")
    assert study.structure.labels == ("J1",)
    assert study.recordings[0].joint == "J1"
    wrong = text.replace(
        "kind: loop, response: {channel: stroke}, force: {array: load}", "use: fit"
    )
    (tmp_path / "study.yaml").write_text(wrong)
    with pytest.raises(ij.InputError, match=r"study.yaml:4: .*joints alone have loops only"):
        read_study(tmp_path / "study.yaml")


@pytest.mark.long
def test_backlash_of_a_friction_damper(reference_data, tmp_path):
    """Of all that is tried it explains most by far; what is left is stick-slip that rings."""
    there = str(reference_data / "friction_damper")
    text = CONFIG.read_text().replace("../../shared/data/friction_damper", there)
    (tmp_path / "study.yaml").write_text(text)
    verdict = ij.load_study(tmp_path / "study.yaml").diagnose().only
    first, *others = verdict.what
    assert (first.kind.name, first.where) == ("backlash", "band")
    assert all(first.probability > 1e3 * each.probability for each in others)
    assert verdict.after.fit < 0.6 * verdict.before.fit
