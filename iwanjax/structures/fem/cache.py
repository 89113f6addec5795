"""Reduced models kept on disk: a mesh of 50 000 degrees of freedom is reduced once."""

import contextlib
import dataclasses
import hashlib
import json
import os
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from iwanjax.errors import InputError
from iwanjax.files import whole_file
from iwanjax.structures.fem.library import skfem
from iwanjax.structures.reduced_model import ReducedModel, SurfaceShape

VERSION = 1
"""Part of every key: raise it with any change of code that changes a result."""


def cached(
    name: str, options: Mapping[str, Any], build: Callable[[], ReducedModel]
) -> ReducedModel:
    """A reduced model from the cache, or built and put there.

    The folder is that of the environment variable ``IWANJAX_CACHE``, else ``iwanjax`` in the
    user's cache. Where it cannot be written, every call builds anew; a file that is damaged,
    or of other options, is never believed.

    Parameters
    ----------
    name : str
        The builder.
    options : mapping
        All that the result depends on: numbers, text, dataclasses and containers of them.
    build : callable
        Makes the model.

    Raises
    ------
    InputError
        For an option that is none of these, and where scikit-fem is missing.
    """
    key = _key(name, options)
    path = _folder() / "fem" / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:24]}.npz"
    found = _read(path, key)
    if found is not None:
        return found
    model = build()
    with contextlib.suppress(OSError):
        _write(path, key, model)
    return model


def _key(name: str, options: Mapping[str, Any]) -> str:
    """Text that is the same exactly for the same options and code."""

    def plain(value: Any) -> Any:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return [type(value).__name__, dataclasses.asdict(value)]
        if isinstance(value, np.generic | np.ndarray):
            return value.tolist()
        raise TypeError

    everything = {"name": name, "version": VERSION, "skfem": skfem().__version__, **options}
    try:
        return json.dumps(everything, default=plain, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError):
        raise InputError(
            f"options of {name} must be finite numbers, text or the documented objects: {options!r}"
        ) from None


def _folder() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("IWANJAX_CACHE") or Path(home) / "iwanjax")


_ARRAYS = ("M", "K", "fixed_frequency", "effective_mass")
_ROWS = ("rows", "sensors", "inputs")


def _write(path: Path, key: str, model: ReducedModel) -> None:
    """Write a model, whole or not at all."""
    arrays = {name: getattr(model, name) for name in _ARRAYS}
    arrays |= {"key": np.array(key), "coordinates": np.array(model.coordinates)}
    n = len(model.M)
    for name in _ROWS:
        rows = getattr(model, name)
        arrays[f"{name}_labels"] = np.array(list(rows), dtype=str)
        arrays[name] = np.array(list(rows.values())).reshape(-1, n)
    arrays["residual_labels"] = np.array(list(model.residual_flexibility), dtype=str)
    arrays["residual"] = np.array(list(model.residual_flexibility.values()))
    if model.shape is not None:
        arrays |= {f"shape_{k}": v for k, v in vars(model.shape).items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        np.savez(file, **arrays)


def _read(path: Path, key: str) -> ReducedModel | None:
    """The model in a file, or None when it is missing, damaged or another."""
    try:
        # A zip file carries a checksum of each array.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            if stored["key"].item() != key:
                return None
            arrays = dict(stored)
        rows = {
            name: dict(zip(arrays[f"{name}_labels"].tolist(), arrays[name], strict=True))
            for name in _ROWS
        }
        residual = zip(arrays["residual_labels"].tolist(), arrays["residual"].tolist(), strict=True)
        shape = {k: arrays[f"shape_{k}"] for k in ("points", "quads", "patch", "recovery")}
        fields: dict[str, Any] = {name: arrays[name] for name in _ARRAYS} | rows
        return ReducedModel(
            **fields,
            coordinates=tuple(arrays["coordinates"].tolist()),
            shape=SurfaceShape(**shape),
            residual_flexibility=dict(residual),
        )
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile):
        return None
