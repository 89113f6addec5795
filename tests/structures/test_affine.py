import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwanjax.errors import InputError
from iwanjax.structures.affine import AffineStructure, Term, spring
from iwanjax.structures.assurance import modal_assurance


def chain(n: int = 5, grounded: bool = True) -> AffineStructure:
    """Masses of 1 + 0.1 i between springs of 100; two springs and a mass vary."""
    difference = np.eye(n)[1:] - np.eye(n)[:-1]
    K = 100.0 * difference.T @ difference
    K[0, 0] += 100.0 if grounded else 0.0
    mass = np.zeros((n, n))
    mass[2, 2] = 1.0
    terms = {
        "ends": spring(difference[0], difference[-1]),
        "middle": spring(difference[1]),
        "added": Term(M=mass),
    }
    return AffineStructure(np.diag(1.0 + 0.1 * np.arange(n)), K, terms)


THETA = jnp.array([40.0, 25.0, 0.3])


def test_matrices_are_the_sum_of_their_terms():
    structure = chain()
    M, K = structure.matrices(THETA)
    assert M[2, 2] == pytest.approx(1.5)
    assert K[0, 1] == pytest.approx(-140.0)
    assert K[1, 2] == pytest.approx(-125.0)


def test_modes_are_those_of_the_linear_structure():
    structure = chain()
    lam, Phi = structure.modes(THETA)
    linear = structure.at(dict(zip(structure.names, THETA.tolist(), strict=True)))
    np.testing.assert_allclose(np.sqrt(lam), linear.modes().omega, rtol=1e-10)
    M, K = structure.matrices(THETA)
    np.testing.assert_allclose(Phi.T @ M @ Phi, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(K @ Phi, M @ Phi * lam, atol=1e-9)


def followed(structure: AffineStructure, theta: jax.Array, which: jax.Array):
    return structure.followed(theta, *structure.modes(theta), which)


@pytest.mark.parametrize("grounded", [True, False])
def test_derivatives_of_modes_agree_with_finite_differences(grounded):
    structure, which = chain(grounded=grounded), jnp.array([1, 3])
    lam_slope, shape_slope = jax.jacfwd(lambda t: followed(structure, t, which))(THETA)
    _, phi = followed(structure, THETA, which)
    for i in range(3):
        step = jnp.zeros(3).at[i].set(1e-5 * THETA[i])
        up, down = (
            followed(structure, THETA + step, which),
            followed(structure, THETA - step, which),
        )
        # Eigenvectors come with either sign.
        signs = [np.sign(np.sum(phi * each[1], axis=0)) for each in (up, down)]
        lam = (up[0] - down[0]) / (2.0 * step[i])
        shape = (up[1] * signs[0] - down[1] * signs[1]) / (2.0 * step[i])
        np.testing.assert_allclose(lam_slope[:, i], lam, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(shape_slope[:, :, i], shape, rtol=1e-5, atol=1e-8)


def test_repeated_modes_have_finite_derivatives():
    structure = AffineStructure(np.eye(2), np.eye(2), {"k": spring([1.0, 0.0], [0.0, 1.0])})
    slope, shape = jax.jacfwd(lambda t: followed(structure, t, jnp.arange(2)))(jnp.array([1.0]))
    np.testing.assert_allclose(slope[:, 0], [1.0, 1.0])
    assert np.all(np.isfinite(shape))


def test_what_is_wrong_with_a_family_is_said():
    with pytest.raises(InputError, match="no terms"):
        AffineStructure(np.eye(2), np.eye(2), {})
    with pytest.raises(InputError, match=r"K of term 'k' has shape \(3, 3\)"):
        AffineStructure(np.eye(2), np.eye(2), {"k": Term(K=np.eye(3))})
    structure = chain()
    with pytest.raises(InputError, match="got ends; expected ends, middle, added"):
        structure.at({"ends": 1.0})
    with pytest.raises(InputError, match="M is not positive definite"):
        structure.at({"ends": 1.0, "middle": 1.0, "added": -2.0})


def test_assurance_is_one_for_the_same_shape_whatever_its_scale():
    shapes = np.random.default_rng(1).standard_normal((6, 3))
    same = modal_assurance(shapes, shapes * np.array([2.0, -3.0, 0.5]))
    np.testing.assert_allclose(np.diag(same), 1.0)
    # Of two random shapes by its definition.
    a, b = shapes[:, 0], shapes[:, 1]
    assert same[0, 1] == pytest.approx((a @ b) ** 2 / (a @ a) / (b @ b))


def test_assurance_in_the_mass_is_the_identity_for_modes():
    structure = chain()
    _, Phi = structure.modes(THETA)
    M, _ = structure.matrices(THETA)
    np.testing.assert_allclose(modal_assurance(Phi, Phi, M), np.eye(5), atol=1e-12)


def test_a_shape_that_no_sensor_sees_is_like_none():
    seen = np.array([[1.0, 1e-9], [2.0, 2e-9]])
    np.testing.assert_array_equal(modal_assurance(seen[:, :1], seen)[0], [1.0, 0.0])
