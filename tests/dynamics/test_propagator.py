"""Coefficients of one step against matrix functions of the first-order form."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from iwanjax.dynamics.propagator import longest_step, propagator

DT = 0.37
SIZES = [0.0, 1e-6, 1e-3, 0.1, 0.49, 0.4999999, 0.5, 0.51, 1.0, 3.0, 30.0, 300.0]
# Around critical damping too, where sines become hyperbolic sines.
RATIOS = [0.0, 1e-4, 0.05, 0.7, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.2, 1.4, 1.5, 20.0]
# Per step: frequency and half of the damping; then rigid bodies, and nearly so, in a liquid.
CASES = [(w, z * w) for w, z in itertools.product(SIZES, RATIOS)]
CASES += itertools.product([0.0, 1e-6, 1e-3], [1e-3, 0.49, 0.51, 3.0, 300.0])
W, S = np.array(CASES).T
OMEGA2, C = (W / DT) ** 2, 2 * S / DT


def first_order(omega2, C, dt):
    """The map of (q, v dt, p_0 dt^2, p_1 dt^2) over one step, forces linear in between."""
    r = len(omega2)
    eye, none = np.eye(r), np.zeros((r, r))
    F = np.block([[none, eye], [-np.diag(omega2) * dt**2, -C * dt]])
    push = np.vstack([none, eye])
    return F, push


def exact(omega2, C, dt):
    r = len(omega2)
    F, push = first_order(omega2, C, dt)
    # p = p_0 + (p_1 - p_0) s: its value and its slope are states.
    whole = np.zeros((4 * r, 4 * r))
    whole[: 2 * r, : 2 * r], whole[: 2 * r, 2 * r : 3 * r] = F, push
    whole[2 * r : 3 * r, 3 * r :] = np.eye(r)
    E = scipy.linalg.expm(whole)[: 2 * r]
    last = E[:, 3 * r :]
    return E[:, : 2 * r], E[:, 2 * r : 3 * r] - last, last


def average_acceleration(omega2, C, dt):
    F, push = first_order(omega2, C, dt)
    eye = np.eye(len(F))
    half = np.linalg.solve(eye - F / 2, push / 2)
    return np.linalg.solve(eye - F / 2, eye + F / 2), half, half


ROUTES = {"exact": exact, "newmark": average_acceleration}


def assert_same(found, expected, dt, tolerance):
    """All coefficients, those of one kind within a share of the largest."""
    A, first, last = expected
    r = A.shape[0] // 2
    q, v = slice(r), slice(r, None)
    kinds = [
        {"qq": A[q, q], "vv": A[v, v], "": np.eye(r)},
        {"qv": A[q, v] * dt},
        {"vq": A[v, q] / dt},
        {"q0": first[q] * dt**2, "q1": last[q] * dt**2},
        {"v0": first[v] * dt, "v1": last[v] * dt},
    ]
    for kind in kinds:
        scale = max(np.max(np.abs(block)) for block in kind.values())
        for name in set(kind) - {""}:
            error = np.max(np.abs(getattr(found, name) - kind[name]))
            assert error <= tolerance * scale, (name, error / scale)


@pytest.mark.parametrize("method", ROUTES)
def test_one_mode_at_any_frequency_and_damping(method):
    found = propagator(jnp.asarray(OMEGA2), jnp.asarray(C), jnp.asarray(DT), method)
    for i, (w, s) in enumerate(CASES):
        one = type(found)(*(np.asarray(x[i : i + 1])[:, None] for x in found))
        expected = ROUTES[method](OMEGA2[i : i + 1], C[i : i + 1, None], DT)
        # The closed form divides round-off by (omega dt)^2 >= 1/4 twice: 16 eps, a few times over.
        # A double root of size w loses w^2 round-offs, the oracle's matrices as many as they are
        # large.
        assert_same(one, expected, DT, 3e-14 * max(1.0, w**2, 2 * s))


@pytest.mark.parametrize("method", ROUTES)
def test_coupled_modes(method):
    rng = np.random.default_rng(3)
    omega2 = np.array([0.0, 1e-4, 2.0, 700.0])
    A = rng.normal(size=(4, 4))
    C = A @ A.T
    found = propagator(jnp.asarray(omega2), jnp.asarray(C), jnp.asarray(DT), method)
    assert_same(found, ROUTES[method](omega2, C, DT), DT, 1e-13)


@pytest.mark.parametrize("method", ROUTES)
def test_coupled_form_of_a_diagonal_is_the_modal_one(method):
    # Up to omega dt = 1; beyond, digits go as above.
    few = np.flatnonzero((W <= 1.0) & (S <= 1.5))
    omega2, damping = jnp.asarray(OMEGA2[few]), jnp.asarray(C[few])
    by_mode = propagator(omega2, damping, jnp.asarray(DT), method)
    coupled = propagator(omega2, jnp.diag(damping), jnp.asarray(DT), method)
    for name, one, other in zip(by_mode._fields, by_mode, coupled, strict=True):
        scale = np.max(np.abs(np.asarray(one)))
        np.testing.assert_allclose(other, np.diag(one), atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize("method", ROUTES)
def test_derivatives(method):
    weights = jnp.asarray(np.random.default_rng(4).normal(size=(8, len(CASES))))

    @jax.jit
    def weighted(omega2, damping):
        found = propagator(omega2, damping, jnp.asarray(DT), method)
        return sum(w * x for w, x in zip(weights, found, strict=True))

    gradients = jax.grad(lambda *a: jnp.sum(weighted(*a)), (0, 1))(OMEGA2, C)
    assert all(bool(jnp.all(jnp.isfinite(g))) for g in gradients)
    # At a double root a derivative is a quotient of differences itself.
    single = np.abs(W - S) > 1e-3 * W
    for i, unit in enumerate((1 / DT**2, 1 / DT)):
        h = 1e-4 * unit * np.eye(2)[i]
        shifted = [weighted(OMEGA2 + s * h[0], C + s * h[1]) for s in (2, 1, -1, -2)]
        expected = np.asarray(8 * (shifted[1] - shifted[2]) - (shifted[0] - shifted[3])) / (
            12e-4 * unit
        )
        size = np.abs(expected) + 1e-3
        error = np.abs(gradients[i] - expected) / size
        assert np.max(error[single]) < 1e-6


def test_longest_step_lowers_the_frequency_by_what_was_asked():
    omega, shift = 30.0, 1e-5
    dt = longest_step(omega, shift)
    by = propagator(jnp.array([omega**2]), jnp.zeros(1), jnp.asarray(dt), "newmark")
    turned = np.arctan2(-float(by.vq[0]) / omega, float(by.qq[0])) / dt
    assert 1 - turned / omega == pytest.approx(shift, rel=1e-3)
