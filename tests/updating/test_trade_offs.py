"""Many sets at once and the Pareto front, held against fits' own predictions and brute force."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import iwanjax as ij
from iwanjax.cluster import pieces
from iwanjax.updating.sampled import deviations, not_beaten
from iwanjax.updating.solution import point

SETS = 128


@pytest.fixture(scope="module")
def system():
    return ij.three_mass()


@pytest.fixture(scope="module")
def curves(system):
    """Of the first two modes, their damping 1.3 times what the joint explains beside its shift."""
    omega = np.asarray(system.modes().omega)
    exact = [ij.qsma(system, r, omega[r] ** 2 * np.geomspace(0.01, 6, 12), 1e-4) for r in (0, 1)]
    return [
        ij.ModalCurves(c.amplitude, c.frequency, 1.3 * np.asarray(c.damping))
        for c in (each.curves for each in exact)
    ]


@pytest.fixture(scope="module")
def sampled(system, curves):
    return ij.sample_fits(system, curves, SETS, fixed=["J1.K_T"], weights=[1.0, 0.1])


def test_a_batch_of_sets_agrees_with_a_fits_prediction_of_each(sampled):
    problem = sampled.problem
    for i in (0, 5, 77):
        there = point(problem, jnp.asarray(sampled.values[i]))
        f, zeta = there.prediction
        parts = [np.asarray(x) for x in deviations(problem, f, zeta, jnp.asarray([1.0, 0.1]))]
        assert np.linalg.norm(parts[0]) == pytest.approx(sampled.frequency_rmsd[i], rel=2e-3)
        assert np.linalg.norm(parts[1]) == pytest.approx(sampled.damping_rmsd[i], rel=2e-3)
        # (3.34) in words: of each curve the mean square, times its weight.
        measured, W = problem.measured, (1.0, 0.1)
        squares = [
            w * np.mean((np.asarray(zeta - measured.damping)[part]) ** 2)
            for w, part in zip(W, measured.slices, strict=True)
        ]
        assert np.linalg.norm(parts[1]) == pytest.approx(np.sqrt(sum(squares)), rel=1e-9)


def test_sets_are_those_of_the_thesis(system, curves, sampled):
    columns = dict(zip(sampled.names, sampled.values.T, strict=True))
    omega2 = np.asarray(system.basis.omega2)
    reach = 0.0
    for r, each in enumerate(curves):
        tip = ij.qsma(system, r, [omega2[r] * each.amplitude[-1] * 0.97], 1e-4)
        reach = max(reach, float(np.abs(tip.deflection).max()))
    joint = ij.Iwan4(*(jnp.asarray(columns[f"J1.{n}"]) for n in ("F_S", "K_T", "chi", "beta")))
    phi, R = np.asarray(joint.phi_max), np.asarray(joint.R)
    chi, K_T = columns["J1.chi"], columns["J1.K_T"]
    share = R * phi ** (chi + 1.0) / ((chi + 1.0) * K_T)  # R over (3.33)
    assert np.all((share > 0.1) & (share < 1.0))
    assert np.all((chi > -1.0) & (chi < 0.0))
    assert phi.min() > 0.9 * reach
    assert phi.max() < 11.0 * reach
    for x in (np.log(share), np.log(phi), chi):
        assert stats.kstest((x - x.min()) / np.ptp(x), "uniform").pvalue > 0.5
    assert np.ptp(K_T) == 0.0


def test_what_is_not_beaten_is_what_brute_force_leaves():
    random = np.random.default_rng(3)
    a, b = random.integers(0, 30, (2, 400)).astype(float)
    a[random.integers(0, 400, 20)] = np.inf
    beaten = [
        np.any((a <= x) & (b <= y) & ((a < x) | (b < y))) or not np.isfinite(x)
        for x, y in zip(a, b, strict=True)
    ]
    wanted = {(x, y) for x, y, lost in zip(a, b, beaten, strict=True) if not lost}
    found = not_beaten(a, b)
    assert {(a[i], b[i]) for i in found} == wanted
    assert len(found) == len(wanted)
    assert np.all(np.diff(a[found]) > 0.0)
    assert np.all(np.diff(b[found]) < 0.0)
    assert not_beaten(np.full(3, np.inf), np.ones(3)).size == 0


@pytest.mark.computes
def test_no_sampled_set_beats_the_front_and_its_ends_are_single_fits(sampled):
    front = ij.pareto_front(sampled, points=5)
    f, zeta = front.frequency_rmsd, front.damping_rmsd
    assert f.size >= 3
    assert np.all(np.diff(f) > 0.0)
    assert np.all(np.diff(zeta) < 0.0)
    for x, y in zip(f, zeta, strict=True):
        better = (sampled.frequency_rmsd < 0.999 * x) & (sampled.damping_rmsd < 0.999 * y)
        assert not np.any(better)
    # Gradients go far below what was sampled, in either direction.
    assert f[0] < 0.2 * sampled.frequency_rmsd.min()
    assert zeta[-1] < 0.5 * sampled.damping_rmsd.min()
    model = front.model()
    joint = model.joints["J1"]
    assert isinstance(joint, ij.Iwan4)
    assert float(joint.chi) == pytest.approx(front.point(front.chosen)["J1.chi"])
    figure = front.plot()
    assert len(figure.axes[0].lines) == 3
    assert "nearest to the best of both" in front.summary()
    assert sampled.summary().startswith(f"{SETS} sets")


def test_parts_of_a_large_batch_change_no_number(system, curves, sampled, monkeypatch):
    monkeypatch.setattr("iwanjax.updating.sampled.AT_ONCE", 50)
    again = ij.sample_fits(system, curves, SETS, fixed=["J1.K_T"], weights=[1.0, 0.1])
    np.testing.assert_allclose(again.frequency_rmsd, sampled.frequency_rmsd, rtol=1e-9)
    np.testing.assert_array_equal(again.front, sampled.front)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:The balance properties")
def test_sixty_parts_on_three_workers_of_which_one_is_killed_change_no_number(
    system, curves, monkeypatch
):
    psutil = pytest.importorskip("psutil")  # comes with distributed
    monkeypatch.setattr("iwanjax.updating.sampled.AT_ONCE", 16)
    asked = {"fixed": ["J1.K_T"], "weights": [1.0, 0.1]}
    here = ij.sample_fits(system, curves, 960, **asked)
    killed = []

    def one_killed(function, items, scheduler, workers):
        assert len(items) == 60
        for i, found in pieces(function, items, scheduler, workers):
            if not killed:
                mine = psutil.Process().children()
                killed.extend([each for each in mine if "spawn_main" in each.cmdline()[-2]][:1])
                killed[0].kill()
            yield i, found

    monkeypatch.setattr("iwanjax.updating.sampled.pieces", one_killed)
    there = ij.sample_fits(system, curves, 960, **asked, scheduler="local", workers=3)
    assert killed
    for name in ("values", "frequency_rmsd", "damping_rmsd"):
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"weights": [1.0]}, "one number for each"),
        ({"weights": [1.0, -1.0]}, "negative"),
        ({"count": 0}, "count = 0"),
        ({"share": (0.1, 2.0)}, "R_max"),
        ({"macroslip": (0.0, 2.0)}, "0 < low <= high"),
        ({"fixed": ["J9.chi"]}, "J9.chi"),
    ],
)
def test_what_cannot_be_sampled_is_refused(system, curves, changed, said):
    with pytest.raises(ij.InputError, match=said):
        ij.sample_fits(system, curves, **{"count": 8, **changed})


def test_a_front_needs_a_choice(sampled):
    with pytest.raises(ij.InputError, match="points = 2"):
        ij.pareto_front(sampled, points=2)
