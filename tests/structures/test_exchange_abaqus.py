"""Abaqus text matrices: assembled by labels or by rows, and element by element."""

import numpy as np
import pytest
from exchange_samples import C, K, M, check, coordinates, put

from iwanjax.errors import InputError
from iwanjax.structures.exchange import read_matrices

STIFFNESS = """\
1,1, 1,1, 5.000000000000000e+02
2,1, 1,1,-3.000000000000000e+02
2,1, 2,1, 7.000000000000000e+02
4,1, 2,1,-4.000000000000000e+02
4,1, 4,1, 4.000000000000000e+02
"""
MASS = "1,1,1,1,2.\n2,1,2,1,3.\n4,1,4,1,4.\n"
DAMPING = "".join(f"{a},1,{b},1,{v}\n" for a, b, v in ((1, 1, 0.5), (1, 2, -0.3), (2, 2, 0.7)))
DAMPING += "2,1,4,1,-0.4\n4,1,4,1,0.4\n"


def job(folder, stiffness=STIFFNESS, mass=MASS):
    put(folder / "job_MASS2.mtx", mass)
    return put(folder / "job_STIF2.mtx", stiffness)


def test_matrix_input_of_one_job(tmp_path):
    put(tmp_path / "job_DMPV2.mtx", DAMPING)
    found = read_matrices(job(tmp_path))
    check(found, damping=True)
    assert [source.rsplit("_", 1)[1] for source in found.sources] == [
        "STIF2.mtx",
        "MASS2.mtx",
        "DMPV2.mtx",
    ]


def turned(line):
    """An entry at its mirror place."""
    node, dof, other, motion, value = line.split(",")
    return ",".join((other, motion, node, dof, value))


@pytest.mark.parametrize(
    "change",
    [
        lambda lines: [
            ",".join([*line.split(",")[2:4], *line.split(",")[:2], line.split(",")[4]])
            for line in lines
        ],
        lambda lines: lines[::-1],
        lambda lines: ["** a comment", "", *lines],
        lambda lines: [line.replace("e+", "D+") for line in lines],
        lambda lines: [*lines, "1,1,2,1,-300.", "2,1,4,1,-400."],
    ],
    ids=["upper triangle", "another order", "comments", "Fortran exponents", "both triangles"],
)
def test_matrix_input_however_it_is_ordered(tmp_path, change):
    check(read_matrices(job(tmp_path, "\n".join(change(STIFFNESS.splitlines())) + "\n")))


def test_matrix_input_blocks_with_names(tmp_path):
    text = (
        "*MATRIX INPUT, NAME=stiff, TYPE=SYMMETRIC, SCALE FACTOR=2.\n"
        + "".join(
            line.rsplit(",", 1)[0] + f",{float(line.rsplit(',', 1)[1]) / 2}\n"
            for line in STIFFNESS.splitlines()
        )
        + f"*MATRIX INPUT, NAME=heavy\n{MASS}** what they are\n"
        + "*MATRIX ASSEMBLE, STIFFNESS=STIFF, MASS=Heavy\n"
    )
    check(read_matrices(put(tmp_path / "model.mtx", text)))


def test_dofs_that_a_boundary_condition_holds_are_left_out(tmp_path):
    held = "9,1, 9,1, 1.000000000000000e+36\n9,2, 9,2, 1.000000000000000e+36\n"
    found = read_matrices(job(tmp_path, STIFFNESS + held, MASS + "9,1,9,1,7.\n"))
    check(found)
    assert "2 DOF(s)" in found.notes[0]
    assert "node 9 ux, node 9 uy" in found.notes[0]


def test_a_dof_without_mass_is_there_all_the_same(tmp_path):
    found = read_matrices(job(tmp_path, mass="1,1,1,1,2.\n4,1,4,1,4.\n"))
    np.testing.assert_array_equal(found.M.toarray(), np.diag([2.0, 0.0, 4.0]))


def test_internal_nodes_have_negative_numbers(tmp_path):
    found = read_matrices(job(tmp_path, STIFFNESS + "-3,1,-3,1,8.\n"))
    assert found.nodes.labels()[0] == (-3, "ux")
    assert found.K.toarray()[0, 0] == 8.0


def test_coordinate_format(tmp_path):
    check(read_matrices(job(tmp_path, coordinates(K), coordinates(M))), dofs=None)


# Springs between nodes 1-2 and 2-4 and one to the ground at 1; two of them along x alone.
ELEMENTS = """\
**
** ELEMENT NUMBER       5 STEP NUMBER       1 INCREMENT NUMBER       1
** ELEMENT TYPE U1
*USER ELEMENT, NODES=     2, LINEAR
** ELEMENT NODES
**       1,       2
    1
*MATRIX,TYPE=STIFFNESS
 500.0               ,
-300.0               ,  300.0
*MATRIX,TYPE=MASS
 2.0                 ,
 0.0                 ,  1.0
** ELEMENT NUMBER       6 STEP NUMBER       1 INCREMENT NUMBER       1
*USER ELEMENT, NODES=     2, LINEAR
** ELEMENT NODES
**       4,       2
    1
*MATRIX,TYPE=STIFFNESS
 400.0               ,
-400.0               ,  400.0
*MATRIX,TYPE=MASS
 4.0                 ,
 0.0                 ,  2.0
"""


def test_element_matrices_are_assembled(tmp_path):
    check(read_matrices(put(tmp_path / "elements.mtx", ELEMENTS)))


def test_an_element_whose_nodes_move_differently(tmp_path):
    # Node 3 along x, node 8 along x and about z, node 5 as node 8; values four a line.
    lower = [[1, 0, 0, 0, 0], [2, 3, 0, 0, 0], [4, 5, 6, 0, 0], [7, 8, 9, 10, 0], range(11, 16)]
    whole = np.array([list(row) for row in lower])
    whole = whole + np.tril(whole, -1).T
    text = (
        "*USER ELEMENT, NODES=3, LINEAR\n** ELEMENT NODES\n** 3, 8\n** 5\n1\n2, 1, 6\n"
        "*MATRIX,TYPE=STIFFNESS\n1.,\n2.,3.\n4.,5.,6.\n7.,8.,9.,10.\n11.,12.,13.,14.\n15.\n"
        "*MATRIX,TYPE=MASS\n1.,\n0.,1.\n0.,0.,1.\n0.,0.,0.,1.\n0.,0.,0.,0.\n1.\n"
    )
    found = read_matrices(put(tmp_path / "element.mtx", text))
    assert found.nodes.labels() == [(3, "ux"), (5, "ux"), (5, "rz"), (8, "ux"), (8, "rz")]
    order = [0, 3, 4, 1, 2]
    np.testing.assert_array_equal(found.K.toarray(), whole[np.ix_(order, order)])
    np.testing.assert_array_equal(found.M.toarray(), np.eye(5))


def test_a_substructure_of_calculix(tmp_path):
    # Retained DOFs stand as nodes of their own, one motion each.
    text = (
        "**\n** GENERATION OF SUBSTRUCTURE\n*USER ELEMENT,NODES=          3,LINEAR\n"
        "** ELEMENT NODES\n**         7,         7,         9,\n         1\n"
        "         2,         2\n         3,         1\n*MATRIX,TYPE=STIFFNESS\n"
        " 0.5000000000000E+01,\n-0.1000000000000E+01, 0.6000000000000E+01,\n"
        "-0.2000000000000E+01,-0.3000000000000E+01, 0.7000000000000E+01,\n"
    )
    mass = put(tmp_path / "M.mtx", "7,1,7,1,1.\n7,2,7,2,1.\n9,1,9,1,1.\n")
    found = read_matrices(put(tmp_path / "sub.mtx", text), mass)
    assert found.nodes.labels() == [(7, "ux"), (7, "uy"), (9, "ux")]
    np.testing.assert_array_equal(found.K.toarray(), [[5, -1, -2], [-1, 6, -3], [-2, -3, 7]])


STEP_2 = ELEMENTS + ELEMENTS.replace("STEP NUMBER       1", "STEP NUMBER       2")
BAD = {
    "text": (STIFFNESS.replace("-3.0", "-x.0", 1), ["line 2", "'-x.000", "not a number"]),
    "cut": (STIFFNESS[:-24] + "\n", ["line 5 holds 4 numbers", "expected 5", "cut short"]),
    "number cut": (STIFFNESS[:-5], ["line 5", "does not end", "cut short"]),
    "line cut off": (STIFFNESS[: STIFFNESS.index("4,1, 4")], ["node 4 ux has no diagonal"]),
    "NaN": (
        STIFFNESS.replace("7.0", "nan", 1).replace("nan00000000000000e+02", "nan"),
        ["line 3", "NaN"],
    ),
    "node of 1.5": (STIFFNESS.replace("4,1, 4", "4.5,1, 4"), ["line 5", "node is 4.5", "whole"]),
    "twice": (STIFFNESS + "4,1, 4,1, 1.\n", ["entry (3, 3) stands 2 times"]),
    "asymmetric": (
        STIFFNESS + "1,1,2,1,7.\n2,1,4,1,-400.\n",
        ["K is not symmetric", "node 1 ux", "node 2 ux"],
    ),
    "six fields": ("1,1,1,1,1,5.\n", ["line 1 holds 6 numbers", "expected 5 or 3"]),
    "another keyword": ("*HEADING\n text\n", ["line 1", "*HEADING"]),
    "empty": ("\n\n", ["is empty"]),
    "step twice": (STEP_2, ["element 5 has its K twice", "one step"]),
    "element cut": (
        ELEMENTS[:-10] + "\n",
        ["line 23", "element 6 has 2 numbers for 2 DOFs", "cut short"],
    ),
    "keyword cut": (ELEMENTS[:-60] + "\n", ["line 22", "*MATRIX is of type", "cut short"]),
    "no nodes": (ELEMENTS.replace("**       4,       2\n", ""), ["line 15", "2 nodes has 0"]),
}


@pytest.mark.parametrize(("text", "words"), BAD.values(), ids=BAD)
def test_bad_files_are_refused_in_one_line(tmp_path, text, words):
    path = job(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_matrices(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_mass_that_is_nowhere(tmp_path):
    path = put(tmp_path / "job_STIF1.mtx", STIFFNESS)
    with pytest.raises(InputError, match=r"the mass is missing: .*pass mass="):
        read_matrices(path)


def test_damping_of_its_own_file(tmp_path):
    found = read_matrices(job(tmp_path), damping=put(tmp_path / "d.mtx", DAMPING))
    np.testing.assert_allclose(found.C.toarray(), C)
