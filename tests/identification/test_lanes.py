"""Steps of a search along a valley that is known in closed form."""

import numpy as np

from iwanjax.estimation.levenberg_marquardt import Descent, Layout, SearchStart
from iwanjax.estimation.linearisation import Linearisation


class Valley:
    """A long, narrow and bent valley (Rosenbrock 1960), as one recording with much silence."""

    @staticmethod
    def residual(x):
        return np.array([1.0 - x[0], 30.0 * (x[1] - x[0] ** 2), *np.zeros(6)]).reshape(1, 8, 1)

    @staticmethod
    def slopes(x):
        J = np.zeros((8, 2))
        J[:2] = [-1.0, 0.0], [-60.0 * x[0], 30.0]
        return J

    @classmethod
    def seen(cls, x):
        e, J = cls.residual(x), cls.slopes(x)
        moment, normal = J.T @ e.ravel(), J.T @ J
        slopes = J.T.reshape(1, 2, 8, 1)
        return Linearisation(np.array([np.sum(e**2)]), moment[None], normal[None], e, slopes)

    @classmethod
    def lane(cls, x):
        layout = Layout(np.zeros((1, 2)), np.eye(2)[None], np.zeros(2), border=8.0)
        return Descent.at(SearchStart(layout, x), 1, cls.seen(x))

    @classmethod
    def steps(cls, bent):
        lane = cls.lane(np.array([-1.2, 1.0]))
        for step in range(200):
            if lane.cost < 1e-6:
                return step
            x = lane.proposed()
            if bent:
                x = lane.along_the_valley(x, cls.residual(lane.glimpse(x)))
            lane.tried(x, cls.residual(x), 0.0)
            lane.renewed(cls.seen(lane.x))
        raise AssertionError("still on the way")


def test_a_bent_step_has_the_residuals_second_derivative():
    lane = Valley.lane(np.array([0.5, 0.3]))
    lane.damping = 1.0
    x = lane.x + np.array([0.2, 0.1])
    bent = lane.along_the_valley(x, Valley.residual(lane.glimpse(x)))
    J = Valley.slopes(lane.x)
    damped = J.T @ J + np.diag(np.diag(J.T @ J))
    second = np.array([0.0, -60.0 * 0.2**2, *np.zeros(6)])
    np.testing.assert_allclose(bent - x, -0.5 * np.linalg.solve(damped, J.T @ second), rtol=1e-9)


def test_along_a_valley_bent_steps_are_fewer():
    assert Valley.steps(True) < 0.7 * Valley.steps(False)
