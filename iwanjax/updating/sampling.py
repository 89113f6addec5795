"""Sampling the posterior of the parameters with emcee's walkers."""

import hashlib
import math
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import emcee
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from iwanjax.correlation import autocorrelation_times
from iwanjax.errors import InputError
from iwanjax.threads import available_threads
from iwanjax.updating.density import (
    NOISE_SCALES,
    Density,
    log_densities,
    spread_of,
    values_of,
)
from iwanjax.updating.posterior import TRUSTED, Posterior
from iwanjax.updating.solution import FitSolution
from iwanjax.updating.straightened import AlongRidges, Straightened

# Steps to the first look at the autocorrelation; the next ones, and copies on disk, come after as
# many or what seems to be missing.
_CHUNK = 250
# That within these parts of the walk so far: times grow with it, and a look takes as long as 40
# steps of the Brake-Reuss beam's.
_PARTS = 32, 8
# Steps after which ridges are straightened by what the walk has seen of them, and again whenever it
# is twice as long: ever rarer, as a walk that learns has to for its means to converge (Chimisov,
# Latuszynski and Roberts, "Air Markov chain Monte Carlo", arXiv:1801.09309).
STRAIGHTENED_AFTER = 1000
# Autocorrelation times that are thrown away at a chain's beginning.
_BURNT = 8.0
# Where fewer proposals than this are taken, steps are half as long: of the Brake-Reuss beam's
# posterior (17 variables) half takes 0.14 instead of 0.03 of them and goes 1.4 times as far in the
# mean square, a quarter 0.32 and 0.9 times.
_RARE = 0.1
_GROUP = "posterior"

_LogDensities = Callable[[np.ndarray], np.ndarray]


def sample_posterior(
    solution: FitSolution,
    *,
    effective: int = 1000,
    walkers: int = 48,
    most_steps: int = 20_000,
    seed: int = 0,
    file: str | Path | None = None,
    progress: bool = False,
) -> Posterior:
    """Sample the parameters' posterior from a fit on (emcee: Foreman-Mackey et al. 2013).

    The density is :class:`~iwanjax.updating.density.Density`: the curves' deviations times
    a scale that is inferred for each kind of data (at least 1 where they hold a model's own error
    or doubt about other modes), and the parameters' priors. All walkers
    are one vectorised, jitted evaluation; the moves are differential evolution with its
    jumps between modes (ter Braak 2006) and the stretch move, in variables in which the
    ridges of microslip data are straight, and from some steps on those that the walk has found
    (:class:`~iwanjax.updating.straightened.Straightened`).

    Parameters
    ----------
    solution : FitSolution
        Where the walkers start; its parameters' priors count.
    effective : int
        Independent samples wanted of every parameter.
    walkers : int
        Even, and at least twice the number of free parameters plus 4.
    most_steps : int
        Where to stop in any case.
    seed : int
        Of the walk.
    file : str or Path, optional
        HDF5 file (emcee's own layout) that the chain is kept in. A walk that was
        interrupted, by kill -9 even, goes on from its last copy when called again.
    progress : bool
        Whether to show a progress bar on stderr.

    Returns
    -------
    Posterior
        With ``enough`` False where the steps did not suffice.

    Raises
    ------
    InputError
        For too few walkers, or a file that belongs to another fit.

    Examples
    --------
    >>> import numpy as np
    >>> import iwanjax as ij
    >>> q, one = np.geomspace(5e-4, 2e-2, 20), np.ones(20)
    >>> mode = ij.ModalOscillator(10.0, 1e-3, ij.Jenkins(F_S=1.0, K_T=500.0))
    >>> f, zeta = mode.ringdown_frequency_and_damping(q)
    >>> curves = ij.ModalCurves(q, f, zeta, frequency_std=1e-3 * one, damping_std=1e-5 * one)
    >>> solution = ij.fit("jenkins", curves)
    >>> posterior = ij.sample_posterior(solution, effective=100, walkers=20, most_steps=300)
    >>> posterior.chain.shape[1:]  # walkers, parameters; a short walk, so posterior.enough is False
    (20, 6)
    """
    problem = solution.problem
    density = Density.of(solution)
    size = len(problem.chart.free) + 2
    if walkers % 2 or walkers < 2 * size:
        raise InputError(
            f"sample_posterior: walkers = {walkers}; expected an even number, at least {2 * size}"
        )
    kept = _Kept(Path(file), solution, walkers) if file is not None else None
    evaluate = _in_pieces(density, walkers // 2)
    walking = partial(_sampler, evaluate, walkers, size)
    sampler = walking()
    if kept:
        kept.read(sampler.backend)
    if sampler.backend.iteration:
        state = sampler.backend.get_last_sample()
        sampler = walking(sampler.backend)
    else:
        np_random = np.random.default_rng(seed)
        state = emcee.State(
            _starts(evaluate, density, solution, walkers, np_random),
            random_state=np.random.RandomState(seed).get_state(),
        )
    chain = _Chain(sampler, effective)
    with tqdm(
        total=effective, disable=not progress, file=sys.stderr, desc="effective samples"
    ) as bar:
        while not chain.enough and sampler.backend.iteration < most_steps:
            sampler.random_state = state.random_state
            gone = sampler.backend.iteration
            ahead = (2 * _straightened(gone) or STRAIGHTENED_AFTER) - gone
            state = _walked(sampler, state, min(chain.missing, ahead, most_steps - gone))
            if sampler.backend.iteration in (_CHUNK, gone + ahead):
                sampler = walking(sampler.backend)
            if kept:
                kept.write(sampler.backend)
            chain = _Chain(sampler, effective)
            bar.n = min(effective, int(chain.effective.min()))
            bar.refresh()
    log_density = np.asarray(sampler.get_log_prob(discard=chain.burnt))
    acceptance = float(np.mean(sampler.acceptance_fraction))
    names = tuple(solution.parameters[i].name for i in problem.chart.free) + NOISE_SCALES
    flat = chain.kept.reshape(-1, size)
    theta = np.asarray(values_of(problem, jnp.asarray(flat[:, :-2])))
    scales = np.exp(density.log_scales(jnp.asarray(flat[:, -2:])))
    values = np.concatenate([theta[:, list(problem.chart.free)], scales], axis=1)
    return Posterior(
        names=names,
        chain=values.reshape(chain.kept.shape),
        log_density=log_density,
        autocorrelation=dict(zip(names, chain.tau.tolist(), strict=True)),
        effective=dict(zip(names, chain.effective.tolist(), strict=True)),
        wanted=effective,
        enough=chain.enough,
        acceptance=acceptance,
        burnt=chain.burnt,
        solution=solution,
    )


def _walked(sampler: emcee.EnsembleSampler, state: emcee.State, steps: int) -> emcee.State:
    """The state after some more steps."""
    found = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
    if found is None:  # emcee's annotation allows for runs of no steps
        raise RuntimeError("emcee returned no state")
    return found


class _Chain:
    """How far a chain has come."""

    def __init__(self, sampler: emcee.EnsembleSampler, wanted: int):
        steps, size = sampler.backend.iteration, sampler.ndim
        self.tau = np.full(size, np.inf)
        self.effective, self.burnt, self.enough = np.zeros(size), 0, False
        self.kept, self.missing = np.empty((0, sampler.nwalkers, size)), _CHUNK
        if not steps:
            return
        whole = np.asarray(sampler.get_chain())
        for _ in range(2):  # The beginning is thrown away before the time is measured again.
            # Of a walker that has not moved yet it is no number.
            with np.errstate(invalid="ignore"):
                tau = autocorrelation_times(whole[self.burnt :])
            self.tau = np.where(np.isfinite(tau) & (tau > 0), tau, steps)
            self.burnt = int(min(0.5 * steps, _BURNT * self.tau.max()))
        self.kept = whole[self.burnt :]
        self.effective = self.kept.shape[0] * self.kept.shape[1] / self.tau
        times = max(TRUSTED, wanted / sampler.nwalkers)
        long = self.kept.shape[0] > TRUSTED * self.tau.max()
        self.enough = bool(long and np.all(self.effective >= wanted))
        missing = (times + _BURNT) * self.tau.max() - steps
        least, most = (steps // part for part in _PARTS)
        self.missing = max(_CHUNK, least, min(most, int(missing)))


class _Kept:
    """The chain on disk, in emcee's own layout: written whole after every chunk of steps.

    emcee's own backend opens its file at every step, which takes longer than the step itself;
    and a process killed while it writes leaves that file unreadable.
    """

    def __init__(self, path: Path, solution: FitSolution, walkers: int):
        self.path, self.new = path, path.with_name(f".{path.name}.new")
        self.new.unlink(missing_ok=True)
        self.fingerprint = _fingerprint(solution, walkers)
        self.found = path.exists()
        if self.found:
            self._check()

    def _check(self) -> None:
        import h5py

        try:
            with h5py.File(self.path, "r") as file:
                known = file[_GROUP].attrs.get("fingerprint", "")
        except (OSError, KeyError):
            raise InputError(
                f"{self.path}: is not a chain of iwanjax; remove it or name another file"
            ) from None
        if known != self.fingerprint:
            raise InputError(
                f"{self.path}: holds the chain of another fit (other data, parameters, priors or "
                "walkers); remove it or name another file"
            )

    def read(self, backend: emcee.backends.Backend) -> None:
        """Bring a backend to where the file left off."""
        if not self.found:
            return
        file = emcee.backends.HDFBackend(str(self.path), name=_GROUP, read_only=True)
        backend.iteration = int(np.asarray(file.iteration))
        backend.chain = np.asarray(file.get_chain())
        backend.log_prob = np.asarray(file.get_log_prob())
        backend.accepted, backend.random_state = np.asarray(file.accepted), file.random_state

    def write(self, backend: emcee.backends.Backend) -> None:
        """Replace the file."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        file = emcee.backends.HDFBackend(str(self.new), name=_GROUP)
        file.reset(backend.nwalkers, backend.ndim)
        file.grow(backend.iteration, None)
        with file.open("a") as opened:
            group: Any = opened[_GROUP]
            group["chain"][...] = backend.get_chain()
            group["log_prob"][...] = backend.get_log_prob()
            group["accepted"][...] = backend.accepted
            for i, part in enumerate(backend.random_state or ()):
                group.attrs[f"random_state_{i}"] = part
            group.attrs.update(iteration=backend.iteration, fingerprint=self.fingerprint)
        self.new.replace(self.path)


def _fingerprint(solution: FitSolution, walkers: int) -> str:
    """Of all that the density depends on."""
    density = Density.of(solution)
    static = jax.tree.structure(density.problem)
    digest = hashlib.sha256(f"{walkers} {density.at_least_one} {static}".encode())
    for leaf in jax.tree.leaves(density.problem):
        digest.update(np.ascontiguousarray(leaf, dtype=float).tobytes())
    for p in solution.parameters:
        # The estimate itself only says where a walk starts.
        prior = ", ".join(f"{leaf}" for leaf in jax.tree.leaves(p.prior))
        digest.update(f"{p.name} {p.fixed} {type(p.prior).__name__} {prior}".encode())
    return digest.hexdigest()


def _in_pieces(density: Density, together: int) -> _LogDensities:
    """Log densities of points (points, variables), so many asked for at a time, on all cores.

    XLA evaluates a batch of this size on one core, so that each core has a piece of it.
    """
    threads = available_threads()
    piece = math.ceil(together / threads)
    # A call takes milliseconds and there are thousands: the density's arrays go in as a plain list,
    # which saves taking it apart every time.
    arrays, rest = eqx.partition(density, eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)

    @jax.jit
    def of_piece(leaves: list[jax.Array], y: jax.Array) -> jax.Array:
        return log_densities(eqx.combine(jax.tree.unflatten(tree, leaves), rest), y)

    pool = ThreadPoolExecutor(threads)

    def evaluate(y: np.ndarray) -> np.ndarray:
        # Pieces of one size: another would be compiled anew.
        filled = np.pad(y, ((0, -len(y) % piece), (0, 0)), mode="edge")
        pieces = filled.reshape(-1, piece, y.shape[1])
        found = pool.map(lambda each: np.asarray(of_piece(leaves, each)), pieces)
        return np.concatenate(list(found))[: len(y)]

    return evaluate


def _sampler(
    evaluate: _LogDensities, walkers: int, size: int, begun: emcee.backends.Backend | None = None
) -> emcee.EnsembleSampler:
    """The walkers with their moves.

    What was begun goes on with steps that its first ones have shown to be of a good length, along
    the ridges that its later ones have seen.
    """
    step = 2.38 / math.sqrt(2.0 * size)  # ter Braak (2006), of a normal distribution
    if begun is not None and _taken(begun) < _RARE:
        step *= 0.5
    # Not the snooker: in emcee 3.1.6 it does not leave a normal distribution as it is.
    moves = [
        (emcee.moves.DEMove(gamma0=step), 0.8),
        (emcee.moves.DEMove(gamma0=1.0), 0.1),
        (emcee.moves.StretchMove(), 0.1),
    ]
    if begun is not None and (seen := _straightened(begun.iteration)):
        points = np.asarray(begun.get_chain())[seen // 2 : seen].reshape(-1, size)
        known = Straightened.of(points)
        moves = [(AlongRidges(move, known), share) for move, share in moves]
    return emcee.EnsembleSampler(
        walkers, size, evaluate, vectorize=True, moves=moves, backend=begun
    )


def _straightened(steps: int) -> int:
    """The last number of steps after which ridges were straightened; 0 before the first."""
    doublings = (steps // STRAIGHTENED_AFTER).bit_length() - 1
    return STRAIGHTENED_AFTER << doublings if doublings >= 0 else 0


def _taken(begun: emcee.backends.Backend) -> float:
    """Share of the first proposals that were taken, by the chain itself: a file has no more."""
    chain = np.asarray(begun.get_chain())[:_CHUNK]
    return float(np.mean(np.any(np.diff(chain, axis=0) != 0.0, axis=2))) if len(chain) > 1 else 1.0


def _starts(
    evaluate: _LogDensities,
    density: Density,
    solution: FitSolution,
    walkers: int,
    random: np.random.Generator,
) -> np.ndarray:
    """Walkers about the estimate with its own covariance, all where the density is not zero."""
    problem = solution.problem
    free = list(problem.chart.free)
    theta = jnp.asarray([p.value for p in solution.parameters])
    center = np.asarray(problem.to_variables(theta))
    values, vectors = np.linalg.eigh(solution.covariance[np.ix_(free, free)])
    root = jnp.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
    spread = np.asarray(spread_of(problem, theta, root))
    misfits = (solution.misfit_frequency, solution.misfit_damping)
    found = np.empty((0, len(free) + 2))
    # On a bound the variable is far out: start where the slope of its map still counts.
    center = np.clip(center, *_reach(solution))
    shrink = 1.0
    while len(found) < walkers:
        z = center + shrink * random.standard_normal((walkers, len(free))) @ spread.T
        z = z + 1e-3 * random.standard_normal(z.shape) * _on_bound(solution)
        scales = [density.scale_starts(misfits, random) for _ in range(walkers)]
        y = np.concatenate([z, scales], axis=1)
        log = evaluate(y)
        found = np.concatenate([found, y[np.isfinite(log)]])
        shrink *= 0.7
        if shrink < 1e-6:
            raise InputError(
                "sample_posterior: the density is zero about the fit; does a prior exclude it?"
            )
    return found[:walkers]


def _on_bound(solution: FitSolution) -> np.ndarray:
    """1e3 for free variables whose parameter rests on a bound, else 0."""
    free = solution.problem.chart.free
    return np.array([1e3 * (solution.parameters[i].name in solution.active_bounds) for i in free])


def _reach(solution: FitSolution) -> tuple[np.ndarray, np.ndarray]:
    """How far out a variable may start: those of parameters on a bound not beyond 3."""
    limit = np.where(_on_bound(solution) > 0, 3.0, np.inf)
    return -limit, limit
