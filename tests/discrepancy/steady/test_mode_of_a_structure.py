"""How far a structure's mode is from an oscillator with one joint, by quasi-statics."""

import numpy as np
import pytest
from concealed.structures import STRUCTURES
from scipy.linalg import eigh

import iwanjax as ij
from iwanjax.settings.steady import SteadySettings
from iwanjax.trial.structure import tangent_stiffness

STROKES = np.geomspace(0.03, 1.0, 16) * 0.35
"""Of the joint, over macroslip."""


def curves_of_mode(structure, mode):
    """Of the structure itself, and the shares of the fall and of the damping that are 1."""
    (name, (F_S, K_T, chi, beta)) = next(iter(structure.joints.items()))
    row = structure.rows[name]
    squared, shapes = eigh(tangent_stiffness(structure), structure.M)
    macroslip = F_S * (1 + beta) / (K_T * (beta + (chi + 1) / (chi + 2)))
    alpha = STROKES * squared[mode] * macroslip / abs(row @ shapes[:, mode])
    jointed = ij.JointedStructure(
        ij.LinearStructure(M=structure.M, K=structure.K, C=0.1 * structure.C),
        {name: (row, ij.Iwan4(F_S, K_T, chi, beta))},
    )
    found = ij.qsma(jointed, mode, alpha, frequency="first_harmonic")
    f, zeta = np.asarray(found.curves.frequency), np.asarray(found.curves.damping)
    return ij.ModalCurves(
        found.q,
        f,
        zeta,
        frequency_std=np.sqrt(squared[mode]) / (2 * np.pi) - f,
        damping_std=zeta,
        quantity="displacement",
        unit="m",
    )


# A mass on a joint is the oscillator, but for how a cycle's first harmonic is told.
@pytest.mark.parametrize(
    ("name", "mode", "least", "most"),
    [
        ("oscillator", 0, 0.0, 0.1 * SteadySettings.model_error),
        ("chain3", 1, 0.5 * SteadySettings.model_error, 2.0 * SteadySettings.model_error),
        ("chain3", 2, 0.5 * SteadySettings.model_error, 2.0 * SteadySettings.model_error),
    ],
)
def test_an_oscillator_is_off_a_structures_mode_by_about_the_model_error(name, mode, least, most):
    curves = curves_of_mode(STRUCTURES[name], mode)
    (model,) = ij.fit("iwan4", curves, reference="absolute", starts=32).predicted
    f_share = (np.asarray(model.frequency) - curves.frequency) / curves.frequency_std
    z_share = (np.asarray(model.damping) - curves.damping) / curves.damping_std
    assert least < float(np.max(np.abs([f_share, z_share]))) < most
