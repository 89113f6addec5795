"""Three masses in a row, and the ways other programs write them down."""

import struct

import numpy as np

# Ground - node 1 - node 2 - node 4, along x.
M = np.diag([2.0, 3.0, 4.0])
K = np.array([[500.0, -300.0, 0.0], [-300.0, 700.0, -400.0], [0.0, -400.0, 400.0]])
C = np.array([[0.5, -0.3, 0.0], [-0.3, 0.7, -0.4], [0.0, -0.4, 0.4]])
DOFS = [(1, "ux"), (2, "ux"), (4, "ux")]


def dense(matrix):
    return matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)


def check(found, *, damping=False, dofs=DOFS):
    """The three masses, whole, on these DOFs."""
    np.testing.assert_allclose(dense(found.M), M, rtol=1e-12)
    np.testing.assert_allclose(dense(found.K), K, rtol=1e-12)
    if damping:
        np.testing.assert_allclose(dense(found.C), C, rtol=1e-12)
    else:
        assert found.C is None
    assert (found.nodes.labels() if found.nodes else None) == dofs


def put(path, text):
    path.write_text(text)
    return path


def coordinates(matrix, *, keep=lambda i, j: True):
    """Lines ``row column value`` as CalculiX writes them: by columns, 13 decimals."""
    n = len(matrix)
    places = [(i, j) for j in range(n) for i in range(n) if matrix[i, j] and keep(i, j)]
    return "".join(f"{i + 1} {j + 1} {matrix[i, j]:20.13e}\n" for i, j in places)


def upper(i, j):
    return i <= j


def calculix(folder, *, K=K, M=M, dof="1.1\n2.1\n4.1\n"):
    put(folder / "job.mas", coordinates(M, keep=upper))
    put(folder / "job.dof", dof)
    return put(folder / "job.sti", coordinates(K, keep=upper))


def op2(matrices):
    """Bytes of a Nastran OUTPUT2 file: each matrix a data block of double precision columns.

    Records stand between their lengths; keys of one word say what follows: how many words, or
    zero or a negative number at the end of a record.
    """

    def record(content):
        return struct.pack("<i", len(content)) + content + struct.pack("<i", len(content))

    def keys(*values):
        return b"".join(record(struct.pack("<i", value)) for value in values)

    parts = [keys(3), record(struct.pack("<3i", 11, 22, 26)), keys(7)]
    parts += [record(b"NASTRAN FORT TAPE ID CODE - "), keys(2), record(b"XXXXXXXX"), keys(-1, 0)]
    for number, (name, matrix) in enumerate(matrices.items()):
        rows, columns = matrix.shape
        title = record(name.ljust(8).encode())
        # Trailer: file, columns, rows, form (6: symmetric), type (2: real double), ...
        trailer = record(struct.pack("<7i", 101 + number, columns, rows, 6, 2, 2 * rows, 10000))
        parts += [keys(2), title, keys(-1, 7), trailer, keys(-2, 1, 0, 2), title, keys(-3, 1, 1)]
        for j in range(columns):
            filled = np.flatnonzero(matrix[:, j])
            first, last = filled[0], filled[-1] + 1
            values = matrix[first:last, j].astype("<f8").tobytes()
            parts += [keys(1 + len(values) // 4), record(struct.pack("<i", first + 1) + values)]
            parts += [keys(0, -4 - j, 1 if j < columns - 1 else 0)]
        parts.append(keys(0))
    return b"".join([*parts, keys(0)])
