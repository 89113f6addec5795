"""Craig-Bampton against textbook partitioning and null-space computations on dense matrices."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from numpy.testing import assert_allclose

from iwanjax.errors import InputError
from iwanjax.structures.frames import Member, Section, frame
from iwanjax.structures.reduction import craig_bampton, full_modes

STEEL = Section(E=2e11, A=4e-4, I=1.2e-8, rho=7800.0)


@pytest.fixture(scope="module")
def beam():
    """A free beam of 20 elements."""
    return frame({"a": (0.0, 0.0), "b": (0.7, 0.0)}, [Member("a", "b", STEEL, 20)])


def sparse(model):
    return sp.csc_array(model.M), sp.csc_array(model.K)


def averages(model):
    """Three interface rows that are not single DOFs: a mean, a difference and a rotation."""
    mean = 0.5 * (model.row("a", "y") + model.row("a-b:1", "y"))
    return np.array(
        [mean, model.row("a-b:1", "y") - model.row("a", "y") + 0.1 * model.row("b", "rz"),
         0.3 * model.row("a", "x") + 0.7 * model.row("a-b:2", "x")]
    )  # fmt: skip


def test_single_dofs_against_partitioning(beam):
    M, K = beam.M, beam.K
    b = [0, 1, 2, len(M) - 2]
    i = np.setdiff1d(np.arange(len(M)), b)
    static = -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    lam, Phi = scipy.linalg.eigh(K[np.ix_(i, i)], M[np.ix_(i, i)])
    found = craig_bampton(*sparse(beam), sp.csr_array(np.eye(len(M))[b]), 5)
    assert_allclose(found.basis[i, :4], static, atol=1e-9)
    assert_allclose(found.basis[b, :4], np.eye(4), atol=1e-12)
    assert_allclose(found.fixed_frequency, np.sqrt(lam[:5]) / (2 * np.pi), rtol=1e-9)
    exact = np.zeros((len(M), 9))
    exact[b, :4], exact[i, :4], exact[i, 4:] = np.eye(4), static, Phi[:, :5]
    # The modes' signs are free.
    signs = np.sign(np.sum(exact * (M @ found.basis), axis=0))
    exact[:, 4:] *= signs[4:]
    for reduced, full in ((found.M, M), (found.K, K)):
        expected = exact.T @ full @ exact
        assert_allclose(reduced, expected, atol=1e-8 * np.abs(expected).max())


def test_averaged_motions_against_the_null_space(beam):
    C = averages(beam)
    L = scipy.linalg.null_space(C)
    lam = scipy.linalg.eigh(L.T @ beam.K @ L, L.T @ beam.M @ L, eigvals_only=True)
    found = craig_bampton(*sparse(beam), sp.csr_array(C), 6)
    assert_allclose(found.fixed_frequency, np.sqrt(lam[:6]) / (2 * np.pi), rtol=1e-8)
    unit = np.hstack([np.eye(3), np.zeros((3, 6))])
    assert_allclose(C @ found.basis, unit, atol=1e-9)
    # Constraint modes are in equilibrium but for forces on the interface.
    forces = L.T @ beam.K @ found.basis[:, :3]
    assert np.abs(forces).max() < 1e-9 * np.abs(beam.K).max()


def test_a_complete_basis_loses_nothing(beam):
    """All but two modes, which is as many as Lanczos finds, and two attachments for the rest."""
    C = sp.csr_array(averages(beam))
    n = len(beam.M)
    loads = sp.csr_array(np.random.default_rng(3).normal(size=(2, n)))
    found = craig_bampton(*sparse(beam), C, n - 5, loads, attach=True)
    assert len(found.M) == n
    reduced = scipy.linalg.eigh(found.K, found.M, eigvals_only=True)
    full = scipy.linalg.eigh(beam.K, beam.M, eigvals_only=True)
    assert_allclose(reduced[3:30], full[3:30], rtol=1e-7)


def test_few_modes_are_too_high_and_converge(beam):
    """Rayleigh: a frequency never rises when the basis grows, nor falls below the full one."""
    full = scipy.linalg.eigh(beam.K, beam.M, eigvals_only=True)[3:6]
    errors = []
    for modes in (4, 8, 12):
        found = craig_bampton(*sparse(beam), sp.csr_array(averages(beam)), modes)
        reduced = scipy.linalg.eigh(found.K, found.M, eigvals_only=True)[3:6]
        errors.append(reduced / full - 1)
    assert np.all(np.array(errors) > -1e-8)
    assert np.all(np.diff(errors, axis=0) < 1e-8)
    assert errors[0].max() > 1e-2
    assert errors[-1].max() < 1e-3


def test_effective_mass_of_a_cantilever(beam):
    """0.6131, 0.1883, 0.0647, 0.0331 of the mass: the clamped-free beam of the textbooks."""
    clamp = sp.csr_array([beam.row("a", motion) for motion in ("x", "y", "rz")])
    found = craig_bampton(*sparse(beam), clamp, 12)
    share = found.effective_mass(np.array([[0.0], [1.0], [0.0]]))[:, 0]
    share /= STEEL.rho * STEEL.A * 0.7
    bending = share[share > 1e-6]
    assert_allclose(bending[:4], [0.6131, 0.1883, 0.0647, 0.0331], atol=2e-4)


def test_attachment_makes_loads_exact(beam):
    """Static flexibility under a load at the tip, clamped: L^3 / 3 E I, and what modes lack."""
    clamp = sp.csr_array([beam.row("a", motion) for motion in ("x", "y", "rz")])
    load = beam.row("b", "y")
    exact = 0.7**3 / (3 * STEEL.E * STEEL.I)
    for attach in (False, True):
        found = craig_bampton(*sparse(beam), clamp, 2, sp.csr_array(load[None]), attach=attach)
        k = len(found.fixed_frequency)
        r = load @ found.basis[:, 3:]
        flexibility = r @ np.linalg.solve(found.K[3:, 3:], r)
        if attach:
            assert k == 3
            assert flexibility == pytest.approx(exact, rel=1e-9)
            assert_allclose(found.M[3:, 3:], np.eye(3))
        else:
            assert found.residual_flexibility[0] == pytest.approx(1 - flexibility / exact, rel=1e-6)
            # First two modes of a cantilever: 12/1.8751^4 + 12/4.6941^4 of the flexibility.
            lacking = 1 - 12 / 1.875104**4 - 12 / 4.694091**4
            assert found.residual_flexibility[0] == pytest.approx(lacking, rel=2e-3)


@pytest.mark.parametrize("stiffness", [0.0, 3e4, np.inf])
def test_full_modes_with_a_spring(beam, stiffness):
    row = beam.row("a", "y") - beam.row("b", "y")
    frequency, shapes = full_modes(*sparse(beam), {"s": (sp.csr_array(row[None]), stiffness)}, 6)
    L = scipy.linalg.null_space(row[None]) if stiffness == np.inf else np.eye(len(row))
    spring = 0.0 if stiffness == np.inf else stiffness
    K = L.T @ (beam.K + spring * np.outer(row, row)) @ L
    lam = scipy.linalg.eigh(K, L.T @ beam.M @ L, eigvals_only=True)[:6]
    rigid = 2 if stiffness else 3
    assert_allclose(frequency[rigid:], np.sqrt(lam[rigid:]) / (2 * np.pi), rtol=1e-7)
    assert np.all(frequency[:rigid] < 1e-2)
    assert_allclose(shapes.T @ beam.M @ shapes, np.eye(6), atol=1e-9)
    if stiffness == np.inf:
        assert np.abs(row @ shapes).max() < 1e-9


BAD = {
    "mechanism": (lambda beam: [beam.row("a", "x"), beam.row("a", "y")], 3, "free to move"),
    "dependent": (
        lambda beam: [beam.row("a", m) for m in ("x", "y", "rz", "x")], 3, "linearly dependent"
    ),
    "zero": (lambda beam: [beam.row("a", "x"), 0 * beam.row("a", "y")], 3, "row 1 is zero"),
    "too many": (lambda beam: averages(beam), 60, "modes = 60"),
    "none": (lambda beam: averages(beam), 0, "modes = 0"),
    "size": (lambda beam: np.ones((1, 4)), 3, "do not fit"),
}  # fmt: skip


@pytest.mark.parametrize(("rows", "modes", "words"), BAD.values(), ids=BAD)
def test_a_bad_interface_is_named(beam, rows, modes, words):
    with pytest.raises(InputError, match=words):
        craig_bampton(*sparse(beam), sp.csr_array(np.array(rows(beam))), modes)
