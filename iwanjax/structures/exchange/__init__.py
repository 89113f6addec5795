"""Users' own mass and stiffness matrices, from the files of other programs."""

from iwanjax.structures.exchange.map_files import read_node_map
from iwanjax.structures.exchange.matrices import ImportedMatrices
from iwanjax.structures.exchange.model import to_model
from iwanjax.structures.exchange.node_map import NodeMap
from iwanjax.structures.exchange.reading import read_matrices
from iwanjax.structures.exchange.report import MatrixReport, check_matrices

__all__ = [
    "ImportedMatrices",
    "MatrixReport",
    "NodeMap",
    "check_matrices",
    "read_matrices",
    "read_node_map",
    "to_model",
]
