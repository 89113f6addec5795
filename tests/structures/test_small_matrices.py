"""Matrix times vector in a form that is quick along many directions: the same numbers."""

import jax
import numpy as np

from iwanjax.structures.small import through, turned


def test_derivatives_are_those_of_the_product():
    """Of the vector and of the matrix, forwards along many directions and backwards."""
    rng = np.random.default_rng(0)
    A, x = rng.standard_normal((5, 3)), rng.standard_normal(3)
    dA, dx = rng.standard_normal((7, 5, 3)), rng.standard_normal((7, 3))

    def along(product):
        return jax.vmap(lambda dA, dx: jax.jvp(product, (A, x), (dA, dx)), out_axes=(None, 0))

    def quick(A, x):
        return through(turned(A), x)

    def plain(A, x):
        return A @ x

    for found, expected in zip(along(quick)(dA, dx), along(plain)(dA, dx), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)
    pull = [jax.vjp(each, A, x)[1](np.arange(5.0)) for each in (quick, plain)]
    for found, expected in zip(*pull, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)
