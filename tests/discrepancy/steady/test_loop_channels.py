"""Joints that depend on a channel beside their loops, by a rig of finer steps."""

import json
import re

import numpy as np
import pytest
from discrepancy.steady.slow_rig import finer, measured, sines, slider
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.discrepancy.steady.diagnose_loops import diagnose_loops
from iwanjax.effects.catalogue import CATALOGUE
from iwanjax.errors import InputError

GUESS = ij.Jenkins(F_S=7.0, K_T=1.2)
BY_CHANNEL = ("slip_force_by_channel", "joint_stiffness_by_channel", "joint_force_by_channel")
TRIED = (*BY_CHANNEL, "cubic_stiffness")
LEVELS = ((8.0, 20.0), (30.0,), (14.0, 25.0))
"""Amplitudes of the loops over a slip of 10, the last one held out."""


def constant(values):
    """A channel that is the same throughout a loop, another one in each."""
    return lambda i, d: np.full_like(d, values[i])


def heating(i, d):
    """Twenty degrees within a loop, the held-out one hotter than all that is fitted."""
    return np.linspace(20.0, 40.0, d.size) + (0.0, 10.0, 40.0)[i]


def pulsing(i, d):
    """A normal load that goes up and down several times a cycle."""
    return 100.0 + (20.0, 30.0, 40.0)[i] * np.sin(0.19 * np.arange(d.size) + i)


def loops(channel, slip=lambda u: 1.0, stiffness=lambda u: 1.0, seed=3):
    """Of a slider of F_S 10 and K_T 1 whose strengths are functions of a channel, of three."""
    random, found = np.random.default_rng(seed), []
    for i, levels in enumerate(LEVELS):
        d = sines(levels)
        u = channel(i, d)
        rig, fine = finer(d), finer(u)
        force = slider(rig, 10.0 * slip(fine), stiffness(fine) + 0.0 * fine)
        held = {"temperature_c": u, "voltage_v": pulsing(2 - i, d), "humidity": 0.4}
        found.append(ij.ForceLoop(d, measured(force, random), f"loop{i}", channels=held))
    return found


def verdict(several, tried=TRIED):
    return diagnose_loops(GUESS, several[:2], several[2], name="J1", hypotheses=tried, starts=8)


FALLS = {"slip": lambda u: 1.0 - 0.004 * (u - 35.0)}
SOFTENS = {"stiffness": lambda u: 1.0 - 0.004 * (u - 35.0)}
BOTH = {each: lambda u: 0.4 + 0.3 * u for each in ("slip", "stiffness")}
NORMAL = {"slip": lambda u: u / 100.0}


@pytest.mark.parametrize(
    ("channel", "depends", "kind", "middle", "change"),
    [
        (heating, FALLS, "slip_force", 35.0, -0.004),
        pytest.param(
            *(constant((20.0, 50.0, 65.0)), SOFTENS, "joint_stiffness", 35.0, -0.004),
            marks=pytest.mark.long,
        ),
        (constant((1.0, 0.0, 3.0)), BOTH, "joint_force", 0.5, 0.3 / 0.55),
        pytest.param(pulsing, NORMAL, "slip_force", 100.0, 0.01, marks=pytest.mark.long),
    ],
)
def test_what_depends_on_a_channel_is_found_and_predicts_other_values_of_it(
    channel, depends, kind, middle, change
):
    told = verdict(loops(channel, **depends))
    first = told.what[0]
    assert (first.label, told.verdict.name) == (f"{kind}_by_temperature_c@J1", "something_missing")
    assert first.probability > 0.95
    (size,) = first.parameters
    assert size.info.dimension == "1/temperature_c"
    # Pulses reach the ends of their range where sines do: to a grid's step.
    assert first.kind.middle == pytest.approx(middle, abs=0.05)
    assert size.value == pytest.approx(change, abs=4.0 * size.std)
    assert size.std < 0.1 * abs(change)
    assert told.after.hold_out < 1.2 * told.noise_floor.hold_out
    # Without it what lies beyond the fitted values is far off.
    assert told.before.hold_out > 5.0 * told.noise_floor.hold_out
    assert "depends on temperature_c" in told.statement()
    (line,) = (each for each in told.warnings if "humidity" in each)
    assert line == (
        "humidity is 0.4 throughout the fitted loops, so nothing shows whether J1 depends on it"
    )


@pytest.mark.parametrize(
    ("channel", "seed"),
    [(heating, 3), *(pytest.param(c, 4, marks=pytest.mark.long) for c in (heating, pulsing))],
)
def test_a_channel_that_does_not_matter_raises_no_alarm(channel, seed):
    told = verdict(loops(channel, seed=seed))
    assert told.verdict.name == "nothing_missing"
    assert told.probability_nothing_missing > 0.95
    assert not told.what


@pytest.mark.long
def test_only_what_a_joint_has_may_depend():
    """A spring's stiffness is its whole force."""
    random, several = np.random.default_rng(5), []
    for i, levels in enumerate(LEVELS):
        d, u = sines(levels), (1.0, 2.0, 3.0)[i]
        held = {"voltage_v": u}
        several.append(ij.ForceLoop(d, measured(u * finer(d), random), f"loop{i}", channels=held))
    told = diagnose_loops(
        ij.LinearSpring(2.0), several[:2], several[2], name="J1", hypotheses=BY_CHANNEL, starts=4
    )
    assert [each.label for each in told.what] == ["joint_force_by_voltage_v@J1"]


@pytest.mark.parametrize("channel", ["u", "a channel", "T {degC}"])
def test_names_of_channels_stand_in_words_as_they_are(channel):
    kind = CATALOGUE["slip_force_by_channel"][0].of(channel, 1.0)
    assert kind.name == f"slip_force_by_{channel}"
    assert (kind.catalogued, kind.variant) == ("slip_force_by_channel", channel)
    assert kind.noun.endswith(f"depends on {channel}")
    said = kind.sentence.format(where="J1", place="at J1")
    assert said == f"The slip force of J1 depends on {channel} (its parameters: at 1)"


def test_loops_of_a_joint_have_the_same_channels():
    several = loops(heating)
    bare = ij.ForceLoop(several[2].d, several[2].force, "cold")
    wanted = "cold: channels: temperature_c is missing, which loop1 has; got none; expected the"
    with pytest.raises(InputError, match=wanted):
        diagnose_loops(GUESS, several[:2], bare)


# --- the command -------------------------------------------------------------------------------


NAMED = ", channels: [temperature_c]"


def study(folder, several, *named, **changed):
    """The command's end, with what the files hold and what the study names of each."""
    entries = []
    for loop, channels in zip(several, named, strict=True):
        held = {"displacement": loop.d.tolist(), "force": loop.force.tolist()}
        held |= {name: u.tolist() for name, u in loop.channels.items()}
        held |= {"humidity": 0.4} | changed
        (folder / f"{loop.name}.json").write_text(json.dumps(held))
        use = "hold_out" if loop is several[-1] else "fit"
        entries.append(f"  - {{file: {loop.name}.json, kind: loop, use: {use}{channels}}}")
    joint = "{name: J1, type: jenkins, parameters: {F_S: 7.0, K_T: 1.2}}"
    lines = ["name: rig", f"model: {{joints: [{joint}]}}", "recordings:", *entries]
    lines += ["hypotheses: [slip_force_by_channel]", "fit: {starts: 8}"]
    (folder / "study.yaml").write_text("\n".join(lines))
    arguments = ["diagnose", str(folder / "study.yaml"), "--out", str(folder / "out")]
    return CliRunner().invoke(app, arguments)


def test_the_command_takes_channels(tmp_path):
    every = ", channels: [temperature_c, voltage_v, humidity]"
    result = study(tmp_path, loops(heating, **FALLS), *[every] * 3)
    assert result.exit_code == 0, result.stderr
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    (entry,) = found["what"]
    assert (entry["kind"], entry["where"]) == ("slip_force_by_channel", "J1")
    assert entry["form"] == "temperature_c"
    assert entry["parameters"]["change"]["unit"] == "1/temperature_c"


@pytest.mark.parametrize(
    ("named", "changed", "told"),
    [
        (
            (NAMED, NAMED, ""),
            {},
            r"study.yaml:6: recordings\[2\] \(loop2.json\): channels: temperature_c is missing, "
            r"which .*recordings\[1\] \(loop1.json\) has; got none; expected .*leave it out there",
        ),
        (
            (NAMED,) * 3,
            {"temperature_c": [1.0, 2.0]},
            r"study.yaml:4: recordings\[0\]: .*loop0.json: channel temperature_c has shape \(2,\); "
            "expected one value, or 481 as displacement and force have",
        ),
        (
            (NAMED,) * 3,
            {"temperature_c": float("nan")},
            "loop0.json: channel temperature_c holds NaN or infinity, first at value 0.*fill the",
        ),
        (
            (", channels: [temperatur_c]",) * 3,
            {},
            "loop0.json: temperatur_c is missing; found .*did you mean 'temperature_c'",
        ),
        (
            (", channels: [temperature_c, temperature_c]",) * 3,
            {},
            r"study.yaml:4: recordings\[0\].channels\[1\]: got temperature_c again",
        ),
    ],
)
def test_the_command_refuses_channels_that_it_cannot_use(tmp_path, named, changed, told):
    result = study(tmp_path, loops(heating), *named, **changed)
    assert result.exit_code == 2
    assert not (tmp_path / "out").exists()
    assert re.search(told, result.stderr), result.stderr
