"""Node maps in files of their own: CalculiX ``.dof``, ANSYS ``.mapping``, and tables."""

from pathlib import Path

from iwanjax.errors import InputError
from iwanjax.structures.exchange.node_map import NodeMap
from iwanjax.structures.exchange.text import text_lines

_SUFFIXES = (".dof", ".mapping", ".csv", ".txt")


def read_node_map(path: str | Path) -> NodeMap:
    """Read which node and motion each row of a matrix stands for.

    Parameters
    ----------
    path : str or Path
        CalculiX ``.dof`` (``node.direction``), ANSYS ``.mapping`` (``equation node DOF``), or
        a ``.csv`` or ``.txt`` table of ``node, DOF`` lines in the order of the rows.

    Raises
    ------
    InputError
        One line naming the file and the line in it: file missing or of unknown kind, text
        for a number, an equation left out, a DOF that stands there twice.
    """
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(
            f"{path}: extension {path.suffix!r} is no node map's; expected {', '.join(_SUFFIXES)}"
        )
    if not path.is_file():
        raise InputError(f"{path}: does not exist; expected a node map")
    try:
        readers = {".dof": read_dof, ".mapping": read_mapping}
        return readers.get(path.suffix.lower(), _read_table)(path)
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def read_dof(path: Path) -> NodeMap:
    """CalculiX: one ``node.direction`` a line, direction 1 to 3 (0 a temperature)."""
    pairs = []
    for number, line in _filled(path):
        node, point, direction = line.strip().partition(".")
        if not (point and _whole(node) and direction.isdigit()):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not node.direction")
        pairs.append((node, direction))
    return _map(path, pairs)


def read_mapping(path: Path) -> NodeMap:
    """ANSYS ``HBMAT, , , , , , , YES``: lines of equation number, node and DOF after a header.

    Mechanical APDL Command Reference, HBMAT.
    """
    found: dict[int, tuple[str, str]] = {}
    for number, line in _filled(path):
        fields = line.split()
        if not fields[0].isdigit() and not found:
            continue  # header
        if len(fields) != 3 or not fields[0].isdigit() or not _whole(fields[1]):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not equation, node, DOF")
        if int(fields[0]) in found:
            raise InputError(f"{path}: line {number}: equation {fields[0]} stands there twice")
        found[int(fields[0])] = (fields[1], fields[2])
    missing = set(range(1, len(found) + 1)) - found.keys()
    if missing or not found:
        raise InputError(
            f"{path}: {f'equation {min(missing)} is' if missing else 'all equations are'} missing; "
            "is the file cut short?"
        )
    return _map(path, [found[i] for i in sorted(found)])


def beside(path: Path, suffix: str) -> Path | None:
    """The file of another extension, in small letters or capitals, next to one."""
    for other in (path.with_suffix(suffix), path.with_suffix(suffix.upper())):
        if other.is_file():
            return other
    return None


def _read_table(path: Path) -> NodeMap:
    pairs = []
    for number, line in _filled(path, whole=False):
        fields = line.replace(",", " ").replace(";", " ").split()
        if not pairs and not _whole(fields[0]):
            continue  # header
        if len(fields) != 2 or not _whole(fields[0]):
            raise InputError(f"{path}: line {number}: {line.strip()!r} is not node, DOF")
        pairs.append((fields[0], fields[1]))
    return _map(path, pairs)


def _filled(path: Path, *, whole: bool = True) -> list[tuple[int, str]]:
    try:
        lines = text_lines(path, whole=whole)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return [(number, line) for number, line in enumerate(lines, 1) if line.strip()]


def _whole(text: str) -> bool:
    return text.strip().removeprefix("-").isdigit()


def _map(path: Path, pairs: list[tuple[str, str]]) -> NodeMap:
    try:
        return NodeMap([int(node) for node, _ in pairs], [dof for _, dof in pairs])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
