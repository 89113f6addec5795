"""Effects concealed in a study's recordings: what is drawn, sealed, told and counted."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import iwanjax as ij
from iwanjax.cli import app
from iwanjax.errors import InputError
from iwanjax.joints import Gap, Jenkins
from iwanjax.studies import trials as of_studies
from iwanjax.trial import TrialPlan, TrialResult, campaign
from iwanjax.trial.acquisition import decimate
from iwanjax.trial.effects import Effect
from iwanjax.trial.files import truth_of, write_study
from iwanjax.trial.foreign_laws import LAWS, SUM_OF
from iwanjax.trial.outcome import TrialOutcome, judged
from iwanjax.trial.plan import FORCES, SIMULATED, UNNAMED, concealed
from iwanjax.trial.simulation import fine_forces, path_at, simulated
from iwanjax.trial.sizes import BANDS, REACHED, Search, scaled, size_for

STUDY = Path(__file__).resolve().parents[2] / "configs" / "concealed_spring.yaml"


def base_of(study, monkeypatch):
    """What effects are concealed in, of a study."""
    caught = []
    monkeypatch.setattr(
        of_studies, "run_trials", lambda base, plan, folder, **_: caught.append(base)
    )
    study.trial("nowhere")
    return caught[0]


@pytest.fixture(scope="module")
def base():
    with pytest.MonkeyPatch.context() as monkeypatch:
        yield base_of(ij.load_study(STUDY), monkeypatch)


@pytest.fixture(scope="module")
def short(base):
    """Its first half second, hit at two places."""
    takes = tuple(
        replace(take, force=take.force[:512], response=take.response[:512])
        for take in base.takes[1:3]
    )
    return replace(base, takes=takes, structure=replace(base.structure, samples=512))


def test_two_integrators_that_share_nothing_agree_far_below_the_noise(base):
    take, steps = base.takes[1], 32
    take = replace(take, force=take.force[:512], response=take.response[:512])
    joints = base.structure.joints
    found = simulated(base, joints, None, [take], steps).response[0]
    structure = ij.load_study(STUDY).structure
    rate = base.structure.rate
    fine = fine_forces([take], 512, steps)[:, 0]
    inputs = np.stack(list(base.structure.inputs.values()))
    response = ij.simulate(structure, fine @ inputs, 1.0 / (rate * steps))
    sensors = np.stack(list(base.structure.sensors.values()))
    seen = decimate(np.asarray(response.acceleration @ sensors.T)[:, None], 512, steps)[:, 0]
    apart = np.sqrt(np.mean((found - seen) ** 2, axis=0))
    assert np.all(apart < 0.3 * base.noise)


def test_steps_are_as_many_as_leave_a_fifth_of_the_noise(short):
    """Of a force that grips and lets go, by one that is beyond all that are tried."""
    effect = Effect("coulomb_friction", "m2-ground", (2e4, 1e-5))
    found = simulated(short, short.structure.joints, effect, short.takes).response
    fine = simulated(short, short.structure.joints, effect, short.takes, 128).response
    for x, y in zip(found, fine, strict=True):
        assert np.all(np.sqrt(np.mean((x - y) ** 2, axis=0)) < 0.2 * short.noise)


def test_a_plan_has_the_sorts_it_is_asked_for_and_shuffles_them():
    sorts = TrialPlan(count=120, seed=3).sorts
    assert [sorts.count(sort) for sort in ("empty", "named", "left_out")] == [40, 53, 27]
    assert sorts != TrialPlan(count=120, seed=4).sorts
    assert set(TrialPlan(count=9, empty=1.0).sorts) == {"empty"}


@pytest.mark.parametrize(("name", "value"), [("empty", 1.2), ("left_out", -0.1), ("count", 0)])
def test_what_is_no_plan_is_refused_by_name(name, value):
    with pytest.raises(InputError, match=f"trial: {name} = "):
        TrialPlan(**{name: value})


def test_a_trial_is_what_its_number_says_and_as_strong_as_it_is_meant_to_be(short):
    plan = TrialPlan(count=3, seed=2, empty=0.0, left_out=0.0)
    one, again = concealed(short, plan, 0), concealed(short, plan, 0)
    assert one.kind == again.kind
    for x, y in zip(one.responses.response, again.responses.response, strict=True):
        np.testing.assert_array_equal(x, y)
    hardest = short.takes.index(short.hardest)
    clean = simulated(short, one.joints, None, [short.hardest]).response[0]
    found = one.responses.response[hardest]
    change = np.sqrt(np.mean((found - clean) ** 2) / np.mean(clean**2))
    low, high = BANDS[one.strength]
    assert 0.9 * REACHED * low < change < 1.1 * high / REACHED


def test_a_law_that_no_steps_follow_at_any_size_has_none_and_others_the_one_that_is_wanted():
    search = Search(lambda s: (s,), 1e-3, 10.0)
    assert np.isnan(size_for(search, lambda sizes: np.full(sizes.shape, np.nan), 0.5))
    too_stiff = size_for(search, lambda sizes: np.where(sizes < 2.0, 0.1 * sizes, np.inf), 0.1)
    assert abs(too_stiff - 1.0) < 0.05


def test_an_empty_trial_differs_from_the_model_by_its_joints_and_noise_alone(short):
    trial = concealed(short, TrialPlan(count=1, empty=1.0), 0)
    assert (trial.kind, trial.effect) == ("none", None)
    clean = simulated(short, trial.joints, None, short.takes).response
    for found, without in zip(trial.responses.response, clean, strict=True):
        noise = np.std(found - without, axis=0)
        np.testing.assert_allclose(noise, short.noise, rtol=0.15)


def test_a_law_left_out_is_not_among_what_the_diagnosis_is_told(short, tmp_path):
    plan = TrialPlan(count=8, seed=1, empty=0.0, left_out=1.0)
    named = [kind for kind in FORCES if kind in short.kinds]
    trial = next(t for i in range(8) if (t := concealed(short, plan, i)).kind in named)
    write_study(short, trial, tmp_path)
    content = yaml.safe_load((tmp_path / "study.yaml").read_text())
    assert trial.kind not in content["hypotheses"]
    assert set(content["hypotheses"]) | {trial.kind} == set(short.kinds)
    # What is concealed is nowhere in what is diagnosed.
    told = "".join(each.name for each in tmp_path.iterdir()) + json.dumps(content["model"])
    assert trial.effect.where in short.structure.rows
    assert trial.kind not in told
    assert truth_of(short, trial)["kind"] == trial.kind
    ij.load_study(tmp_path / "study.yaml")


def test_every_law_that_may_be_concealed_is_integrated(short):
    take, joints = short.hardest, short.structure.joints
    take = replace(take, force=take.force[:256], response=take.response[:256])
    without, path = path_at(short, joints, take, "m2-ground", 4)
    for kind in (*FORCES, *UNNAMED):
        act = SIMULATED.get(kind, kind)
        search = scaled(short.structure, act, "m2-ground", path, np.random.default_rng(0))
        values = tuple(float(v) for v in search.build(np.float64(0.05)))
        (found,) = simulated(short, joints, Effect(act, "m2-ground", values), [take], 4).response
        assert np.isfinite(found).all(), kind
        assert np.any(found != without), kind


@pytest.fixture
def in_process(monkeypatch):
    """Pieces one after another, here, and diagnoses that name the stiffness of m2."""
    calls = []

    def one_by_one(function, items, scheduler, workers):
        return ((i, function(item)) for i, item in enumerate(items))

    def said(piece):
        calls.append(piece)
        assert set(piece.files) == {"model.npz", "rec1.npz", "rec2.npz", "study.yaml"}
        first = {"kind": "stiffness_error", "where": "m2-ground", "probability": 0.8}
        ratio = {"after": {"hold_out": 0.012}, "noise_floor": {"hold_out": 0.01}}
        content = {
            "verdict": "something_missing",
            "probability_nothing_missing": 0.1,
            "probability_something_else": 0.1,
            "what": [first],
            "fit": ratio,
        }
        return {"diagnosis": content, "seconds": 1.0}

    monkeypatch.setattr(campaign, "pieces", one_by_one)
    monkeypatch.setattr(campaign, "diagnosed", said)
    return calls


def test_a_trial_goes_on_where_it_was_and_notices_a_truth_that_was_changed(
    short, in_process, tmp_path
):
    plan = TrialPlan(count=2, empty=1.0)

    def run(plan=plan):
        return campaign.run_trials(short, plan, tmp_path, progress=lambda line: None)

    first = run()
    assert len(in_process) == 2
    (tmp_path / "verdicts" / "trial001.json").unlink()
    assert run().outcomes == first.outcomes
    assert len(in_process) == 3
    with pytest.raises(InputError, match=r"sealed\.json: holds the plan"):
        run(replace(plan, seed=7))
    truth = tmp_path / "truth" / "trial000.json"
    truth.write_text(truth.read_text().replace('"none"', '"gap_contact"'))
    with pytest.raises(InputError, match=r"trial000\.json: is not what was sealed"):
        run()


def test_the_command_writes_what_it_found_and_counts_false_alarms(
    short, in_process, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        of_studies,
        "run_trials",
        lambda base, plan, folder, **k: campaign.run_trials(short, plan, folder, progress=print),
    )
    out = tmp_path / "out"
    asked = ["trial", str(STUDY), "--out", str(out), "--count", "2", "--empty", "1"]
    run = CliRunner().invoke(app, asked)
    assert run.exit_code == 0, run.output
    assert "nothing concealed: false alarms: 2 of 2" in run.output
    told = json.loads((out / "trial.json").read_text())
    assert told["brier"]["nothing is missing"] == pytest.approx(0.81)
    assert TrialResult.load(out / "trial.npz").brier == pytest.approx(told["brier"]["all"])
    assert (out / "trial.png").stat().st_size > 10_000


def outcome(sort, kind="", where="", **more):
    return TrialOutcome("t", sort, kind, where, "medium" * bool(kind), **more)


def test_outcomes_are_counted_as_they_are():
    found = TrialResult(
        "s",
        0,
        (
            outcome("empty", verdict="nothing_missing", nothing=1.0, ratio=1.0),
            outcome(
                "empty",
                verdict="something_missing",
                said_kind="gap_contact",
                said_where="a",
                first=0.6,
                nothing=0.4,
                ratio=1.0,
            ),
            outcome(
                "named",
                "gap_contact",
                "a",
                verdict="something_missing",
                said_kind="gap_contact",
                said_where="a",
                first=1.0,
                ratio=1.4,
            ),
            outcome(
                "left_out",
                "pinched",
                "b",
                verdict="undecided",
                said_kind="unnamed_law",
                said_where="b",
                first=0.9,
                something_else=0.9,
                ratio=1.9,
            ),
            outcome("left_out", "bristles", "b", verdict="error", message="no"),
        ),
    )
    counted = {each.what: (each.hits, each.of) for each in found.counts}
    assert counted == {
        "nothing concealed: false alarms": (1, 2),
        "nothing concealed: said so": (1, 2),
        "in the catalogue: kind and place right": (1, 1),
        "nothing or in the catalogue: held out within 1.3 floors": (2, 3),
        "law left out: place first": (1, 2),
        "law left out: no wrong name above 0.5": (2, 2),
        "law left out: held out within 2 floors": (1, 2),
        "ended with an error": (1, 5),
    }
    nothing, first, other = found.forecasts
    assert nothing.brier == pytest.approx(0.6**2 / 4)
    assert first.brier == pytest.approx(0.6**2 / 2)
    assert other.brier == pytest.approx(0.1**2 / 4)
    rows, columns, counts = found.confusion
    assert counts[rows.index("gap_contact"), columns.index("gap_contact")] == 1
    assert counts.sum() == 5
    assert "bristles (left out) @ b" in found.summary()


def test_a_verdict_of_two_effects_is_judged_by_its_first():
    truth = {"sort": "named", "kind": "gap_contact", "where": "a", "strength": "weak"}
    what = [
        {"kind": "gap_contact", "where": "a", "probability": 0.7},
        {"kind": "mass_error", "where": "b", "probability": 0.9},
    ]
    said = {
        "verdict": "something_missing",
        "probability_nothing_missing": 0.0,
        "probability_something_else": 0.1,
        "what": what,
        "fit": {"after": {"hold_out": None}, "noise_floor": {"hold_out": None}},
    }
    found = judged("t", truth, {"diagnosis": said, "seconds": 3.0})
    assert found.right
    assert found.wrong_name == 0.9
    assert np.isnan(found.ratio)


def judged_as(kind, *names):
    """Of a law left out at a and names there, each with its probability."""
    what = [{"kind": name, "where": "a", "probability": p} for name, p in names]
    truth = {"sort": "left_out", "kind": kind, "where": "a", "strength": "medium"}
    said = {
        "verdict": "something_missing",
        "probability_nothing_missing": 0.0,
        "probability_something_else": 0.0,
        "what": what,
        "fit": {"after": {"hold_out": 1.0}, "noise_floor": {"hold_out": 1.0}},
    }
    return judged("t", truth, {"diagnosis": said, "seconds": 1.0})


def test_all_that_a_law_is_a_sum_of_is_no_wrong_name_and_a_part_alone_is():
    friction, gap = ("coulomb_friction", 0.9), ("gap_contact", 0.9)
    both = judged_as("rubbing_freeplay", friction, gap)
    assert both.right
    assert both.named
    assert not judged_as("rubbing_freeplay", friction).named
    assert judged_as("rubbing_freeplay", friction).wrong_name == 0.9
    assert judged_as("rubbing_freeplay", friction, ("gap_contact", 0.2)).wrong_name == 0.9
    assert judged_as("pinched", friction, gap).wrong_name == 0.9


def test_freeplay_in_which_something_rubs_is_the_sum_of_what_is_said_of_it():
    assert SUM_OF == {"rubbing_freeplay": ("coulomb_friction", "gap_contact")}
    k, gap, F, dt = 2e4, 3e-4, 2.0, 1e-3
    d = 1e-3 * np.sin(np.linspace(0.0, 20.0, 2001))
    v = np.gradient(d, dt)
    law = LAWS["rubbing_freeplay"](dt, *np.array([[k], [gap], [F]]))
    force = [law(*pair)[0] for pair in np.stack([d, v], axis=1)[..., None]]
    parts = [Jenkins(F_S=F, K_T=k), Gap(k=k, gap=gap)]
    np.testing.assert_allclose(force, sum(along(part, d, v, dt) for part in parts), atol=1e-9)


def along(joint, d, v, dt):
    """Force of an element, from rest on."""
    element = joint.discrete()

    def advance(state, end):
        found = element.step(*end, dt, state)
        return found.state, found.force

    return np.asarray(jax.lax.scan(advance, element.init(), (d, v))[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint": ij.Jenkins(F_S=50.0, K_T=1e5)}, "joint J1 is a Jenkins; trial knows iwan4"),
        ({"force": None}, "has no force; trial needs forces"),
    ],
)
def test_what_trials_do_not_know_is_said_in_a_line(change, message):
    t = np.arange(2048) / 2048.0
    force = change.get("force", np.where(t < 0.004, 50.0, 0.0)[:, None])
    about = {} if force is None else {"force": force, "inputs": ["m1"]}
    motion = np.exp(-5 * t) * np.sin(2 * np.pi * 40 * t)
    recording = ij.as_recording(
        motion, sampling_rate=2048, quantity="acceleration", sensors=["a1"], **about
    )
    joint = change.get("joint", ij.Iwan4(F_S=50.0, K_T=1e4, chi=-0.5, beta=1.0))
    structure = ij.JointedStructure(
        ij.LinearStructure([[1.0]], [[2.0]], [[5e4]]), {"J1": ([1.0], joint)}
    )
    study = ij.Study(
        structure,
        [recording],
        rows={"m1-ground": [1.0]},
        sensors={"a1": [1.0]},
        inputs={"m1": [1.0]},
    )
    with pytest.raises(InputError, match=message):
        study.trial("nowhere")


def test_single_modes_are_no_structure():
    mode = {"name": "mode1", "band": (90, 150), "joint": {"type": "iwan4"}}
    with pytest.raises(InputError, match="trial needs a structure"):
        ij.Study(modal=[mode]).trial("nowhere")


@pytest.mark.long
def test_trials_end_to_end_on_two_workers(tmp_path):
    pytest.importorskip("distributed")
    found = ij.load_study(STUDY).trial(tmp_path, count=2, seed=5, empty=0.5, left_out=0.0)
    assert [each.verdict for each in found.outcomes].count("nothing_missing") == 1
    assert all(each.right for each in found.outcomes)
