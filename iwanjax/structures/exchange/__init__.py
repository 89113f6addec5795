"""Users' own mass and stiffness matrices, from the files of other programs."""

from iwanjax.structures.exchange.map_files import read_node_map
from iwanjax.structures.exchange.matrices import ImportedMatrices
from iwanjax.structures.exchange.node_map import NodeMap
from iwanjax.structures.exchange.reading import read_matrices

__all__ = ["ImportedMatrices", "NodeMap", "read_matrices", "read_node_map"]
