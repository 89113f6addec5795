"""What small forces would change if no joint slipped meanwhile: all of them for a convolution."""

from collections.abc import Iterator, Sequence

import numpy as np

from iwanjax.discrepancy.band import passed
from iwanjax.discrepancy.fitting import Fitted
from iwanjax.discrepancy.observer import stepped
from iwanjax.discrepancy.search import Search
from iwanjax.discrepancy.trials import Unit


def columns_at_rest(
    search: Search, base: Fitted, forces: Sequence[Unit]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Changes of the residuals for forces of size 1, the joints at their tangents.

    At rest the model is linear and the same at all times, so that a force's response is its
    convolution with the place's own.

    Parameters
    ----------
    search : Search
        Predictor and data.
    base : Fitted
        The model with its joints refitted, and the suspects found so far.
    forces : sequence of Unit
        In any order.

    Yields
    ------
    (lanes,), (lanes, recordings x N x sensors) array
        Place by place, which of the forces act there and their columns.
    """
    weight = np.moveaxis(np.asarray(search.data.weight), 1, 2)
    R, _, N = weight.shape
    at: dict[str, list[int]] = {}
    for i, unit in enumerate(forces):
        at.setdefault(unit.where, []).append(i)
    rows = np.stack([forces[which[0]].row for which in at.values()])
    shown = _responses(search, base, rows[:, : search.predictor.kept], N)
    # Twice as long: what leaves at the end does not come in again at the beginning.
    spectra = np.fft.rfft(shown, 2 * N) * passed(2 * N)
    for which, own in zip(at.values(), spectra, strict=True):
        found = []
        for i in which:
            steps = np.moveaxis(forces[i].force.reshape(R, N, -1), 1, 2)
            whole = np.einsum("rkf,ksf->rsf", np.fft.rfft(steps, 2 * N), own)
            change = np.fft.irfft(whole, 2 * N)[..., :N] * weight
            found.append(np.ravel(np.moveaxis(change, 2, 1)))
        yield np.array(which), np.stack(found)


def _responses(search: Search, base: Fitted, rows: np.ndarray, N: int) -> np.ndarray:
    """Residuals after a force of 1 at the end of one step, (places, substeps, sensors, N).

    It rises over that step, and falls over the next; one for each step to the first sample.
    """
    predictor, suspects = search.predictor, base.hypothesis.suspects
    mean = base.theta.mean(axis=0)[None, : base.values]
    gain = search.gains([suspects], mean, base.cycles, slopes=False).gain[0]
    A, H = search.system(suspects, mean[0])
    P, r = rows.shape
    dt, S = float(predictor.dt), predictor.substeps
    # The force and its slope as states too (Van Loan 1978).
    F = np.zeros((2 * r + 2 * P, 2 * r + 2 * P))
    F[: 2 * r, : 2 * r] = A
    F[r : 2 * r, 2 * r : 2 * r + P] = rows.T
    F[2 * r : 2 * r + P, 2 * r + P :] = np.eye(P)
    E = stepped(F, dt)
    step, whole, ramp = E[: 2 * r, : 2 * r], E[: 2 * r, 2 * r : 2 * r + P], E[: 2 * r, 2 * r + P :]
    rising, falling = (ramp / dt).T, (whole - ramp / dt).T
    direct = np.zeros((P, S, len(H)))
    if predictor.quantity == "acceleration":
        direct[:, -1] = rows @ np.asarray(predictor.sensors).T
    z = np.zeros((P, S, 2 * r))
    shown = np.zeros((N, P, S, len(H)))
    for n in range(N):
        for k in range(S):
            z = z @ step.T
            if n == 0:
                z[:, k] += rising
                z[:, k - 1] += falling if k else 0.0
            elif n == 1 and k == 0:
                z[:, -1] += falling
        # It opposes the motion, so that the model shows less.
        shown[n] = z @ H.T + (direct if n == 0 else 0.0)
        z = z - shown[n] @ gain.T
    return np.moveaxis(shown, 0, 3)
