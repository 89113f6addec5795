"""Effects take their forces, values and limits from the joints of the same law."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import iwanjax as ij
from iwanjax.effects.catalogue import (
    CATALOGUE,
    catalogue,
    kinds_in_time,
    kinds_of,
    limits_outside,
)
from iwanjax.effects.kinds import ForceKind, JointKind
from iwanjax.files.trees import read_tree, write_tree
from iwanjax.joints import JOINTS, AbstractStepped, ParameterInfo, PlaceMotion, Scales

FORCES = [kind for kinds in catalogue().values() for kind in kinds if isinstance(kind, ForceKind)]


@pytest.mark.parametrize("kind", FORCES, ids=lambda kind: f"{kind.name} {kind.variant}".strip())
def test_an_effect_is_its_joint_driven_along_the_same_motion(kind: ForceKind):
    """As `hysteresis` drives it: the discrete element's own step, of its own code.

    What K holds of it already is no force of the effect.
    """
    d, dt, size, shape = 0.02 * np.sin(np.arange(200) * 0.13) ** 3, 0.01, 3.0, 0.007
    joint = kind.law.scaled(size, shape, **dict(kind.held))
    force = ij.hysteresis(joint, d, dt=dt)
    if kind.within:
        force = force - joint.initial_stiffness * d
    rates = np.diff(d, prepend=0.0) / dt
    # The acceleration that a discrete element sees: see its docstring.
    a = np.diff(rates, prepend=rates[0]) / dt
    a[2:] = (1.5 * rates[2:] - 2.0 * rates[1:-1] + 0.5 * rates[:-2]) / dt
    along = PlaceMotion(*map(jnp.asarray, (d, rates, a, rates * dt, np.full(d.shape, dt))))

    def step(memory: Array, at: PlaceMotion) -> tuple[Array, Array]:
        unit, memory = kind.unit_force(at, jnp.asarray(shape), memory)
        return memory, unit

    _, unit = jax.lax.scan(step, jnp.zeros(()), along)
    found = size * np.asarray(unit)
    assert np.ptp(found) > 0.0
    np.testing.assert_allclose(found, force, rtol=1e-12, atol=1e-15)


NAMES = {
    "stiffness_error": ("k",),
    "mass_error": ("m",),
    "viscous_damping": ("c",),
    "cubic_stiffness": ("k3",),
    "quadratic_stiffness": ("k2",),
    "gap_contact": ("k", "gap"),
    "bilinear_stiffness": ("dk",),
    "coulomb_friction": ("k", "slip"),
    "quadratic_damping": ("c2",),
    "viscoelastic": ("k", "tau"),
}
EITHER_SIGN = {"gap_contact", "coulomb_friction", "viscoelastic"} ^ NAMES.keys()


@pytest.mark.parametrize("name", NAMES)
def test_names_and_signs_are_those_of_diagnosis_json(name):
    for kind in CATALOGUE[name]:
        assert isinstance(kind, ForceKind)
        infos = [kind.size] if kind.shape is None else [kind.size, kind.shape]
        assert tuple(info.name for info in infos) == NAMES[name]
        assert kind.positive == (name not in EITHER_SIGN)


class Shaped(AbstractStepped):
    """A law with a shape, whose search does not know where to begin."""

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        ParameterInfo("k", "force/length", "stiffness"),
        ParameterInfo("width", "length", "width"),
    )
    rate_dependent: ClassVar[bool] = False
    k: Array = eqx.field(converter=jnp.asarray)
    width: Array = eqx.field(converter=jnp.asarray)

    def follow(self, motion: PlaceMotion, memory: Array) -> tuple[Array, Array]:
        return self.k * self.width * jnp.tanh(motion.d / self.width), memory


class Begun(Shaped):
    """A law with a shape: its search begins at half of what the place has seen."""

    @classmethod
    def starts(cls, seen: Scales) -> tuple[float, ...]:
        return (0.5 * seen.deflection,)


class Third(Begun):
    """A law with a third parameter that nobody holds."""

    parameters: ClassVar[tuple[ParameterInfo, ...]] = (
        *Shaped.parameters,
        ParameterInfo("third", "1", "one more"),
    )
    third: Array = eqx.field(converter=jnp.asarray)


class Held(Begun):
    """A law that is only tried when asked for."""

    tried: ClassVar[bool] = False


@pytest.fixture
def registered():
    before = dict(JOINTS)
    yield lambda name, law: ij.register_joint(name, law)
    JOINTS.clear()
    JOINTS.update(before)


def test_a_registered_law_is_a_hypothesis(registered: Any):
    assert "begun" not in catalogue()
    registered("begun", Begun)
    registered("begun", Begun)
    registered("held", Held)
    (kind,) = kinds_of(("begun",))
    assert isinstance(kind, ForceKind)
    assert kind in kinds_of()
    assert kind.shapes(Scales(2.0, 1.0)) == (1.0,)
    assert kind.usual == "A law with a shape"
    (held,) = kinds_of(("held",))
    assert isinstance(held, ForceKind)
    assert held not in kinds_of()
    # In motions it is tried where others leave much, with all of its parameters.
    (whole,) = kinds_in_time(("held",))
    assert isinstance(whole, JointKind)
    assert whole in kinds_in_time()
    assert [info.name for info in whole.parameters] == ["k", "width"]


@pytest.mark.parametrize(
    ("name", "law", "message"),
    [
        ("shaped", Shaped, "give it starts"),
        ("third", Third, "third of Third needs a default"),
        ("gap", Begun, "already names Gap"),
    ],
)
def test_a_law_that_a_search_cannot_begin_with_is_refused(registered: Any, name, law, message):
    with pytest.raises(ij.InputError, match=message):
        registered(name, law)


def test_a_law_by_the_name_of_another_kind_is_refused(registered: Any):
    registered("stiction", Begun)
    with pytest.raises(ij.InputError, match="'stiction' is a kind of the catalogue"):
        kinds_of()


def test_no_kind_of_the_whole_catalogue_has_a_limit_outside():
    assert limits_outside(kinds_in_time()) == ()


@pytest.mark.parametrize(
    ("tried", "outside"),
    [
        ("coulomb_friction", {"stiffness_error"}),
        ("attached_oscillator", {"mass_error", "viscous_damping"}),
        ("viscoelastic", {"stiffness_error", "viscous_damping"}),
        ("cubic_stiffness", set()),
    ],
)
def test_limits_of_what_is_tried_that_are_not_tried_are_known(tried, outside):
    assert {kind.name for kind in limits_outside(kinds_in_time((tried,)))} == outside


@pytest.mark.parametrize("of", [kinds_of, kinds_in_time])
def test_all_kinds_can_be_saved(of, tmp_path):
    """As a verdict's suspects are: none holds a function."""
    kinds = of()
    # As printed: some have numbers that are not yet known, NaN.
    assert repr(read_tree(write_tree(tmp_path / "kinds.npz", kinds))) == repr(kinds)
