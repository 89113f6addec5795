"""What a modal test says."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from iwanjax.errors import InputError
from iwanjax.modal_analysis.poles import Stabilisation
from iwanjax.results import AbstractResult, with_std
from iwanjax.signals.frf import FrequencyResponses
from iwanjax.structures import LinearTrust
from iwanjax.structures.assurance import modal_assurance
from iwanjax.structures.model_file import Model
from iwanjax.structures.tested import model_of_modes
from iwanjax.tables import Block, Grid


@dataclass(frozen=True, eq=False)
class ModalTest(AbstractResult):
    """Result of :func:`iwanjax.modal_test`: modes with deviations, and how well they fit.

    Attributes
    ----------
    frequency, frequency_std : (n,) array
        Natural frequencies, Hz.
    damping, damping_std : (n,) array
        Damping ratios, an exponential window's part taken off.
    shapes, shapes_std : (s, n) array
        At the sensors: mass-normalised, 1/sqrt(kg) where forces are in N and responses in m,
        or where no driving point was measured with 1 at the largest.
    drives : (i, n) array
        At the inputs, in the same scale; empty of free decays.
    scaled : bool
        Whether shapes are mass-normalised.
    residual_frequency, residual_damping : (r,) array
        Of the modes that stand for those below and above the band, Hz.
    residual_shapes, residual_drives : (s, r), (i, r) array
        Of these.
    responses : FrequencyResponses
        Measured.
    fitted : (F, s, i) array
        The same functions of the modes.
    distortion : (F, s, i) array
        Deviation of the complex value that they were weighted by: scatter, or what is left
        beside the modes at neighbouring lines, whichever is more.
    misfit : (s,) array
        Root mean square of fitted minus measured, as share of the measured.
    scatter : (s,) array
        The same of the scatter of averages; NaN where there is one average per input.
    stabilisation : Stabilisation
        Poles of all orders.
    sites : dict of str to str
        Driving points: the sensor at each input's place.
    converged : bool
        Whether the fit ended by its tolerance.
    warnings : tuple of str
        What to know before these modes are used.
    """

    frequency: Float[np.ndarray, " n"]
    frequency_std: Float[np.ndarray, " n"]
    damping: Float[np.ndarray, " n"]
    damping_std: Float[np.ndarray, " n"]
    shapes: Float[np.ndarray, "s n"]
    shapes_std: Float[np.ndarray, "s n"]
    drives: Float[np.ndarray, "i n"]
    scaled: bool
    residual_frequency: Float[np.ndarray, " r"] = field(repr=False)
    residual_damping: Float[np.ndarray, " r"] = field(repr=False)
    residual_shapes: Float[np.ndarray, "s r"] = field(repr=False)
    residual_drives: Float[np.ndarray, "i r"] = field(repr=False)
    responses: FrequencyResponses = field(repr=False)
    fitted: Complex[np.ndarray, "F s i"] = field(repr=False)
    distortion: Float[np.ndarray, "F s i"] = field(repr=False)
    misfit: Float[np.ndarray, " s"]
    scatter: Float[np.ndarray, " s"]
    stabilisation: Stabilisation = field(repr=False)
    sites: dict[str, str]
    converged: bool
    warnings: tuple[str, ...] = ()

    @property
    def assurance(self) -> Float[np.ndarray, "n n"]:
        """Modal assurance of each two shapes at the sensors."""
        return np.asarray(modal_assurance(self.shapes, self.shapes))

    @property
    def trust(self) -> LinearTrust:
        """How exact the linear model is: what a diagnosis takes where a study says nothing."""
        order = np.argsort(np.r_[self.frequency, self.residual_frequency], kind="stable")
        held = np.zeros(len(self.residual_frequency))
        size = np.sqrt(np.mean(self.shapes**2))
        return LinearTrust(
            frequencies=tuple(np.r_[self.frequency_std / self.frequency, held][order].tolist()),
            damping=tuple(np.r_[self.damping_std / self.damping, held][order].tolist()),
            shapes=float(np.sqrt(np.mean(self.shapes_std**2)) / size),
        )

    def model(self) -> Model:
        """The linear model: a structure of these modes, with rows, sensors and inputs.

        Coordinates are modal, residual modes included, lowest frequency first.

        Raises
        ------
        InputError
            Where no driving point was measured, so that masses are not known.
        """
        if not self.scaled:
            raise InputError(
                "shapes are not mass-normalised, so that there is no structure: "
                + (
                    "free decays tell no masses"
                    if self.responses.excitation == "decay"
                    else f"say which sensor is where {self.responses.inputs[0]} acts, by "
                    f"driving_points: {{{self.responses.inputs[0]}: "
                    f"{self.responses.sensors[0]}}} for instance"
                )
            )
        frequency = np.r_[self.frequency, self.residual_frequency]
        order = np.argsort(frequency, kind="stable")
        damping = np.r_[self.damping, self.residual_damping][order]
        shapes = np.c_[self.shapes, self.residual_shapes][:, order]
        drives = np.c_[self.drives, self.residual_drives][:, order]
        return model_of_modes(
            2.0 * np.pi * frequency[order],
            damping,
            dict(zip(self.responses.sensors, shapes, strict=True)),
            dict(zip(self.responses.inputs, drives, strict=True)),
        )

    def _blocks(self) -> tuple[Block, ...]:
        known = self.responses
        driven = (
            f"{known.averages} free decay(s)"
            if known.excitation == "decay"
            else f"{known.averages} average(s), {known.excitation}, {', '.join(known.inputs)}"
        )
        left = (
            f"Beside the modes {100 * self.misfit.min():.2g} to {100 * self.misfit.max():.2g} % is "
            "left of each sensor's response"
        )
        if np.all(np.isfinite(self.scatter)):
            left += f"; its scatter is {100 * self.scatter.max():.2g} % at most"
        modes = zip(self.frequency, self.frequency_std, self.damping, self.damping_std, strict=True)
        scale = "mass-normalised" if self.scaled else "1 at the largest"
        header = ("mode", "frequency Hz", "damping %", *known.sensors)
        rows = tuple(
            (
                str(k + 1),
                with_std(f, f_std),
                with_std(100.0 * z, 100.0 * z_std),
                *(
                    with_std(phi, std)
                    for phi, std in zip(self.shapes[:, k], self.shapes_std[:, k], strict=True)
                ),
            )
            for k, (f, f_std, z, z_std) in enumerate(modes)
        )
        return (
            f"{len(self.frequency)} modes between {known.frequency[0]:.4g} and "
            f"{known.frequency[-1]:.4g} Hz, of {driven}; shapes are {scale}",
            Grid(header, rows),
            left + ".",
            *(f"  {each}" for each in self.warnings),
        )
