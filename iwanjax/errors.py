"""The errors a user can meet: what arrived, what was expected, what to try."""


class IwanjaxError(Exception):
    """Base of every error raised on purpose; the command line prints it as one line."""


class InputError(IwanjaxError, ValueError):
    """An argument, array or file that cannot be used as it is."""


class AccuracyError(InputError):
    """A step, or a grid, at which a result would not be what it claims to be."""


class PrecisionError(IwanjaxError, RuntimeError):
    """A computation that needs float64 in a session that computes in float32."""
