"""Modules import one way only: from strictly lower layers or from their own room.

A room is a module or package directly under ``iwanjax``. Imports inside functions and under
``TYPE_CHECKING`` count too, since a reader has to follow them all the same.
"""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

LAYERS = [
    {
        "errors",
        "types",
        "curves",
        "results",
        "tables",
        "files",
        "threads",
        "compiler",
        "kernels",
        "cluster",
    }
    | {"settings", "correlation"},
    {"joints", "signals"},
    {"structures", "effects"},
    {"quasistatic", "dynamics"},
    {"estimation"},
    {"updating", "modal_analysis", "trial"},
    {"identification"},
    {"discrepancy", "config"},
    {"planning"},
    {"studies"},
    {"plotting"},
    {"report"},
    {"verbs"},
    {"cli"},
]
# Rooms that hold mathematics only, and the one that others are tried by, which has physics of its
# own: they import of layer 0 and nothing else.
KNOW_NO_PHYSICS = {"estimation", "trial"}
LAYER_OF = {room: layer for layer, rooms in enumerate(LAYERS) for room in rooms}

PACKAGE = Path(__file__).resolve().parents[1] / "iwanjax"


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(name: str) -> str:
    """Second part of a dotted name; empty for iwanjax itself."""
    return "".join(name.split(".")[1:2])


PATHS = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
ROOMS = sorted({room_of(module) for module in PATHS} - {"", "__main__"})


def imports(module: str, source: str, is_package: bool = False) -> set[str]:
    """Absolute names of what ``source`` imports from iwanjax, whether modules or their contents.

    Importing the package itself, or a name from it, gives ``"iwanjax"``.
    """
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = module.split(".")
            base = parents[: len(parents) - node.level + is_package] if node.level else []
            base = ".".join([*base, *filter(None, [node.module])])
            found |= {base if base == "iwanjax" else f"{base}.{alias.name}" for alias in node.names}
    return {name for name in found if name.split(".")[0] == "iwanjax"}


def faults(module: str, imported: set[str]) -> list[str]:
    """What is wrong with ``module`` importing these names, one sentence each."""
    room = room_of(module)
    found = []
    for name in sorted(imported):
        target = room_of(name)
        if not target:
            found.append(f"{module} imports iwanjax itself; import from the module that defines it")
        elif not room:
            if target == "cli":
                found.append("iwanjax imports cli, which every user of the library would then load")
        elif room == "__main__" or target == room:
            continue
        elif unplaced := {room, target} - LAYER_OF.keys():
            found.append(f"place {', '.join(sorted(unplaced))} in the table LAYERS of this test")
        elif room in KNOW_NO_PHYSICS and LAYER_OF[target] > 0:
            found.append(f"{module} knows no physics and imports {name}")
        elif LAYER_OF[target] >= LAYER_OF[room] and not LAYER_OF[target] == LAYER_OF[room] == 0:
            found.append(
                f"{module} (layer {LAYER_OF[room]}) imports {name} (layer {LAYER_OF[target]})"
            )
    return found


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Some cycle of the import graph, or nothing."""
    # A name that is no module is something defined in the module it is imported from.
    edges = {
        module: {name if name in graph else name.rpartition(".")[0] for name in imported}
        for module, imported in graph.items()
    }
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def imports_of(module: str) -> set[str]:
    path = PATHS[module]
    return imports(module, path.read_text(encoding="utf-8"), path.name == "__init__.py")


@pytest.mark.parametrize("module", PATHS)
def test_imports_point_to_lower_layers(module):
    assert not faults(module, imports_of(module))


@pytest.mark.parametrize("room", ROOMS)
def test_every_room_has_a_layer(room):
    assert room in LAYER_OF, f"place {room} in the table LAYERS of this test"


# Rooms inside a room: either stands on what both share, beside each other and on nothing of theirs.
# The package's own ``__init__``, which names what users see of all, is no part of what is shared.
BESIDE = {"iwanjax.discrepancy": ("histories", "steady")}


def side_of(name: str) -> tuple[str, str]:
    """Room with rooms inside it that a name is in, and which of those; empty where it is shared."""
    for outer, sides in BESIDE.items():
        if name.startswith(f"{outer}."):
            inner = name.removeprefix(f"{outer}.").split(".")[0]
            return outer, inner if inner in sides else ""
    return "", ""


def strays(module: str, imported: set[str]) -> list[str]:
    """Names that a module imports from a room beside its own, or below what both share."""
    outer, own = side_of(module)
    sides = [(name, *side_of(name)) for name in sorted(imported)]
    return [
        name for name, other, side in sides if outer and other == outer and side not in ("", own)
    ]


@pytest.mark.parametrize("module", [m for m in PATHS if side_of(m)[0]])
def test_rooms_beside_each_other_share_only_what_is_in_neither(module):
    assert not strays(module, imports_of(module))


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("histories.ranking", "steady.fit.SteadyFit"),
        ("steady.fit", "histories.ranking"),
        ("judgement", "histories.recordings.common_noise"),
        ("judgement", "steady"),
    ],
)
def test_a_stray_import_is_found(module, name):
    at = "iwanjax.discrepancy"
    assert strays(f"{at}.{module}", {f"{at}.{name}", f"{at}.evidence.shares"}) == [f"{at}.{name}"]
    assert not strays(at, {f"{at}.{name}"})


def test_no_module_imports_itself_by_a_detour():
    assert not cycle({module: imports_of(module) for module in PATHS})


@pytest.mark.parametrize(
    ("module", "source", "fault"),
    [
        ("iwanjax.joints.iwan4", "from iwanjax.structures import LinearStructure", "layer 2"),
        ("iwanjax.joints.iwan4", "import iwanjax.signals.recording", "layer 1"),
        ("iwanjax.joints.iwan4", "def f():\n    from ..cli import main", "layer 13"),
        ("iwanjax.joints.iwan4", "from iwanjax import Iwan4", "imports iwanjax itself"),
        ("iwanjax.curves", "import iwanjax", "imports iwanjax itself"),
        ("iwanjax.curves", "from . import errors", "imports iwanjax itself"),
        ("iwanjax.joints.iwan4", "from iwanjax.attic import junk", "place attic"),
        ("iwanjax", "from iwanjax.cli import main", "imports cli"),
        ("iwanjax.estimation.evidence", "from iwanjax.joints import Iwan4", "knows no physics"),
        ("iwanjax.estimation.evidence", "from iwanjax.updating import fit", "knows no physics"),
    ],
)
def test_a_bad_import_is_found(module, source, fault):
    (found,) = faults(module, imports(module, source))
    assert fault in found


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("iwanjax.joints.iwan4", "from .power import power\nfrom iwanjax.types import real"),
        ("iwanjax.structures.jointed", "from iwanjax.joints import Iwan4\nimport numpy"),
        ("iwanjax.curves", "from iwanjax.errors import InputError"),
        ("iwanjax", "from iwanjax.plotting import curves"),
        ("iwanjax.estimation.parameters", "from iwanjax.errors import InputError"),
        ("iwanjax.__main__", "from iwanjax.cli import main"),
    ],
)
def test_a_good_import_passes(module, source):
    assert not faults(module, imports(module, source))


def test_a_cycle_is_found():
    assert cycle({"iwanjax.a": {"iwanjax.b.name"}, "iwanjax.b": {"iwanjax.a"}})
    assert not cycle({"iwanjax.a": {"iwanjax.b.name"}, "iwanjax.b": set()})
