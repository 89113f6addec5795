"""Plain arrays out of container files: NumPy ``.npz``, MATLAB ``.mat``, HDF5.

Nothing in a file is ever executed: pickled objects are refused.
"""

from iwanjax.files.arrays import existing_file, read_arrays
from iwanjax.files.nodes import Node, TooLarge, Unreadable, nearest
from iwanjax.files.whole import whole_file

__all__ = [
    "Node",
    "TooLarge",
    "Unreadable",
    "existing_file",
    "nearest",
    "read_arrays",
    "whole_file",
]
