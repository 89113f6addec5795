"""Where a model is clearly off measured curves."""

import numpy as np

from iwanjax.discrepancy.observables import CLEAR, Observable
from iwanjax.discrepancy.steady.curve_run import CurveRun

# Of curves, level by level: share of the levels that have to differ so clearly.
_ENOUGH = 0.05


def clear_differences(run: CurveRun, mode: int, called: str) -> tuple[Observable, ...]:
    """Where a model is clearly off the curves of a mode, the largest difference first."""
    found = []
    for name, model, seen in zip(run.names, run.predicted, run.measured, strict=True):
        x = np.asarray(seen.amplitude)
        for quantity in ("frequency", "damping"):
            y, std = (np.asarray(getattr(seen, quantity + end)) for end in ("", "_std"))
            off = np.asarray(getattr(model, quantity)) - y
            clear = np.abs(off) > CLEAR * std
            if clear.mean() > _ENOUGH:
                span = (float(x[clear].min()), float(x[clear].max()))
                percent = 100.0 * float(np.median(off[clear] / y[clear]))
                found.append(Observable(name, mode, quantity, span, percent, called))
    return tuple(sorted(found, key=lambda each: -abs(each.difference_percent)))
