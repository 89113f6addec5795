"""Reading mass, stiffness and damping matrices from the files of other programs."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeAlias

from iwanjax.errors import InputError
from iwanjax.files import existing_file, nearest
from iwanjax.structures.exchange.abaqus import read_abaqus
from iwanjax.structures.exchange.calculix import read_calculix
from iwanjax.structures.exchange.containers import read_container
from iwanjax.structures.exchange.contents import Contents, Matrix
from iwanjax.structures.exchange.harwell_boeing import read_harwell_boeing
from iwanjax.structures.exchange.joining import joined
from iwanjax.structures.exchange.map_files import beside, read_node_map
from iwanjax.structures.exchange.matrices import ImportedMatrices
from iwanjax.structures.exchange.matrix_market import is_matrix_market, read_matrix_market
from iwanjax.structures.exchange.nastran import read_op2, read_op4
from iwanjax.structures.exchange.node_map import NodeMap

_Reader: TypeAlias = Callable[[Path], Contents]


def _mtx(path: Path) -> Contents:
    return (read_matrix_market if is_matrix_market(path) else read_abaqus)(path)


READERS: dict[str, _Reader] = {
    **dict.fromkeys((".npz", ".mat", ".h5", ".hdf5"), read_container),
    ".mtx": _mtx,
    ".op4": read_op4,
    ".op2": read_op2,
    **dict.fromkeys((".sti", ".mas"), read_calculix),
    **dict.fromkeys((".matrix", ".hb", ".rsa", ".rua"), read_harwell_boeing),
}
"""What reads a file, by its extension."""

_LETTERS = {"K": "K", "M": "M", "C": "BC", "T": "T"}
_WORDS = {"K": "stiffness", "M": "mass", "C": "damping", "T": "recovery"}
# job_STIF2.mtx of Abaqus and what lies beside it.
_ABAQUS_JOB = re.compile(r"(.*_)STIF(\d+)", re.IGNORECASE)


def read_matrices(
    path: str | Path,
    mass: str | Path | None = None,
    damping: str | Path | None = None,
    *,
    nodes: NodeMap | str | Path | None = None,
    names: Mapping[str, str] | None = None,
) -> ImportedMatrices:
    """Read M, K and C of M u'' + C u' + K u = f that another program wrote.

    * NumPy ``.npz``, MATLAB ``.mat``, HDF5 ``.h5``/``.hdf5``: arrays M, K, optional C, T, ``nodes``
      and ``dofs``.
    * Matrix Market ``.mtx``, one file a matrix.
    * Nastran ``.op4`` and ``.op2`` (extra ``nastran``): data blocks such as KAA, MAA, BAA.
    * Abaqus ``.mtx``: assembled, ``job_STIF1.mtx`` with ``job_MASS1.mtx`` and ``job_DMPV1.mtx``
      beside it, or element matrices.
    * CalculiX ``job.sti`` with ``job.mas`` and ``job.dof`` beside it.
    * ANSYS ``HBMAT`` files ``.matrix``, ``.hb``, ``.rsa``, ``.rua``, each with its ``.mapping``.

    Parameters
    ----------
    path : str or Path
        The file of the stiffness, or of all matrices.
    mass, damping : str or Path, optional
        Files of the mass and of the viscous damping where they are others.
    nodes : NodeMap, str or Path, optional
        What the rows stand for, or a file that says so (:func:`read_node_map`), instead
        of what comes with the matrices.
    names : mapping of str to str, optional
        Names in the files for K, M, C or T, where a file holds several matrices that may be
        meant: ``{"K": "KAA", "M": "MAA"}``.

    Returns
    -------
    ImportedMatrices
        On the DOFs of all files: where each has its own node map, rows are put in one
        order and a DOF that a matrix lacks is zero there. DOFs that Abaqus holds by a
        boundary condition are left out.

    Raises
    ------
    InputError
        One line naming the file: missing, of unknown kind, cut short, damaged, without
        the matrices wanted; and as :class:`ImportedMatrices`.
    """
    path = Path(path)
    wanted = dict(names or {})
    for role in wanted:
        if role not in _LETTERS:
            raise InputError(f"names: {role!r} is none of {', '.join(_LETTERS)}")
    main = _contents(path)
    files = {"K": path, "M": mass, "C": damping}
    if len(main.matrices) == 1 and mass is None:
        files |= _partners(path, damping)
    parts: dict[str, tuple[Matrix, NodeMap | None]] = {}
    sources, fixed = [path], set(main.fixed)
    if files["M"] is None:
        chosen = _paired(path, main, wanted)
        parts = {role: (main.matrices[name], main.nodes) for role, name in chosen.items()}
    for role in "KMC" if not parts else "C":
        file = files[role]
        if file is not None:
            contents = main if file == path else _contents(Path(file))
            parts[role] = (_chosen(Path(file), contents, role, wanted), contents.nodes)
            sources += [] if file == path else [Path(file)]
            fixed |= contents.fixed
    try:
        return joined(parts, _given(nodes), fixed, tuple(map(str, sources)))
    except InputError as error:
        raise InputError(f"{', '.join(map(str, sources))}: {error}") from None


def _contents(path: Path) -> Contents:
    existing = existing_file(path, (suffix for suffix in READERS if suffix not in CONTAINERS))
    try:
        contents = READERS[existing.suffix.lower()](existing)
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None
    except Exception as error:  # libraries raise a dozen kinds for damaged files
        raise InputError(
            f"{path}: cannot be read as {path.suffix} ({type(error).__name__}: "
            f"{' '.join(str(error).split())}); is it cut short? export it again"
        ) from None
    return contents


CONTAINERS = tuple(suffix for suffix, reader in READERS.items() if reader is read_container)
"""Extensions of files that hold arrays of any kind."""


def _partners(path: Path, damping: str | Path | None) -> dict[str, str | Path | None]:
    """Files of the mass and the damping that programs write next to the stiffness."""
    if path.suffix.lower() == ".sti":
        return {"M": beside(path, ".mas")}
    job = _ABAQUS_JOB.fullmatch(path.stem)
    if job is None:
        return {}
    others = {
        role: path.with_name(f"{job[1]}{word}{job[2]}{path.suffix}")
        for role, word in (("M", "MASS"), ("C", "DMPV"))
    }
    found: dict[str, str | Path | None] = {r: f if f.is_file() else None for r, f in others.items()}
    return found if damping is None else found | {"C": damping}


def _paired(path: Path, contents: Contents, wanted: Mapping[str, str]) -> dict[str, str]:
    """Names of K, M and what belongs to them in a file that holds them all."""
    by_capitals = {name.upper(): name for name in contents.matrices}
    endings = [
        name[1:] for name in by_capitals if name[:1] == "K" and f"M{name[1:]}" in by_capitals
    ]
    if {"K", "M"} <= wanted.keys():
        ending = None
    elif "" in endings or len(endings) == 1:
        ending = "" if "" in endings else endings[0]
    elif endings:
        pairs = ", ".join(f"K{ending} with M{ending}" for ending in endings)
        raise InputError(
            f"{path}: holds {pairs}; say which by names={{'K': ..., 'M': ...}} of read_matrices"
        )
    else:
        held = " and ".join(sorted(contents.matrices)) or "no matrix with a name"
        sole = len(contents.matrices) == 1 and "M" not in by_capitals
        missing = "the mass" if sole else "a K and an M that belong together"
        raise InputError(
            f"{path}: {missing} is missing: it holds {held}; pass mass= with the file of the mass, "
            "or names= if they are called otherwise"
        )
    found = {role: _name(path, contents, name) for role, name in wanted.items()}
    for role, letters in _LETTERS.items():
        for letter in letters:
            # Nastran's damping is BAA; a plain B is rather the rows of the joints.
            known = ending is not None and (letter != "B" or ending)
            name = by_capitals.get(f"{letter}{ending}") if known else None
            if name is not None:
                found.setdefault(role, name)
    return found


def _chosen(path: Path, contents: Contents, role: str, wanted: Mapping[str, str]) -> Matrix:
    """The matrix of one role in a file of its own."""
    if role in wanted:
        return contents.matrices[_name(path, contents, wanted[role])]
    held = list(contents.matrices)
    if len(held) == 1 and (held[0] == role or held[0] not in _WORDS):
        return contents.matrices[held[0]]
    fitting = [name for name in held if name[:1].upper() in _LETTERS[role]]
    if len(fitting) != 1:
        raise InputError(
            f"{path}: holds {', '.join(sorted(held)) or 'no matrix'}; say which is the "
            f"{_WORDS[role]} by names={{{role!r}: ...}} of read_matrices"
        )
    return contents.matrices[fitting[0]]


def _name(path: Path, contents: Contents, name: str) -> str:
    for held in contents.matrices:
        if held.upper() == name.upper():
            return held
    raise InputError(
        f"{path}: holds no matrix {name!r} but {', '.join(sorted(contents.matrices)) or 'none'}"
        f"{nearest(name, contents.matrices)}"
    )


def _given(nodes: NodeMap | str | Path | None) -> NodeMap | None:
    return nodes if nodes is None or isinstance(nodes, NodeMap) else read_node_map(nodes)
