"""What the package is made of, counted from its sources: ``make house`` prints it beside bounds.

Run as a script it ends with 1 where a count has risen above its bound. ``test_house.py`` holds the
same bounds in every test run.
"""

import ast
import json
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeGuard

ROOT = Path(__file__).resolve().parents[1]

BOUNDS = {
    "class names used twice": 0,
    "tuned numbers": 985,
    "tuned numbers without a comment": 141,
    "laws outside joints": 0,
    "least-squares loops of the host": 1,
    "modules that index a parameter map": 0,
    "public names": 88,
    "declared, never imported": 0,
}
"""Counts of the whole package: they only fall. Lower a bound with the step that lowers its count;
raise one only with a reason in the commit message."""

MODULES = {
    ".": 12,
    "config": 21,
    "discrepancy": 32,
    "dynamics": 16,
    "estimation": 13,
    "identification": 37,
    "files": 6,
    "modal_analysis": 5,
    "plotting": 21,
    "quasistatic": 10,
    "report": 3,
    "structures": 41,
    "studies": 14,
    "trial": 11,
    "updating": 22,
    "verbs": 13,
}
"""Modules of each room. Joints and signals grow by design: a law and a kind of recording are one
file each; rooms to come are counted from when they stand here."""

MOST_LINES = 400
"""Of a module."""

LONGER = {"report": 419}
"""Lines of the longest module where that is more; these only fall."""

# Names under which distributions are imported, where they differ.
_IMPORTED_AS = {"scikit-fem": "skfem", "pyyaml": "yaml", "sdypy-ema": "sdypy"}
# Run, not imported: linters, test runners, notebook runners.
_TOOLS = {"dev", "notebooks"}
# What a law reads of the motion of its place: deflection, rate, acceleration, change in a step.
_MOTION = {"d", "v", "a", "moved"}
_SOLVES = re.compile(r"^(np|numpy|scipy|sla|la)\.(linalg\.)?(solve|lstsq|cho_solve|lu_solve)$")
_LAWS = re.compile(r"Abstract(Joint|Spring|Iwan|Discrete|ForceLaw|Stepped)")
_SLOT = re.compile(r"slots?$")


class Room(NamedTuple):
    """A folder of the package, or the modules beside the folders."""

    modules: int
    longest: int
    longest_name: str
    tuned: int
    undocumented: int


class TunedNumber(NamedTuple):
    """Numbers that one statement assigns to constants of a module or fields of settings."""

    module: Path
    line: int
    names: tuple[str, ...]
    literals: int
    documented: bool


@cache
def sources(root: Path = ROOT) -> dict[Path, str]:
    """Modules of the package by path below it."""
    package = root / "iwanjax"
    return {
        path.relative_to(package): path.read_text(encoding="utf-8")
        for path in sorted(package.rglob("*.py"))
    }


@cache
def _tree(text: str) -> ast.Module:
    return ast.parse(text)


@cache
def _walk(text: str) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(_tree(text)))


def room_of(module: Path) -> str:
    """Folder directly under the package; ``.`` for modules beside the folders."""
    return module.parts[0] if len(module.parts) > 1 else "."


def numbers(node: ast.AST) -> int:
    """Number literals in an expression; True and False are none."""
    return sum(
        isinstance(each, ast.Constant) and type(each.value) in (int, float)
        for each in ast.walk(node)
    )


def _targets(node: ast.stmt) -> tuple[str, ...]:
    if isinstance(node, ast.Assign):
        found = node.targets
    elif isinstance(node, ast.AnnAssign) and node.value is not None:
        found = [node.target]
    else:
        return ()
    return tuple(n.id for t in found for n in ast.walk(t) if isinstance(n, ast.Name))


def _documented(body: list[ast.stmt], i: int, lines: list[str]) -> bool:
    """Whether a comment stands above or beside a statement, or a docstring below it."""
    node = body[i]
    above = lines[node.lineno - 2].strip() if node.lineno > 1 else ""
    beside = lines[(node.end_lineno or node.lineno) - 1]
    below = body[i + 1] if i + 1 < len(body) else None
    return (
        above.startswith("#")
        or "  # " in beside
        or (
            isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
            and isinstance(below.value.value, str)
        )
    )


def tuned_numbers(module: Path, text: str) -> Iterator[TunedNumber]:
    """Numbers in a module's constants, and defaults of its frozen settings.

    A study file's sections (room ``config``) are their user's settings and count for nothing.
    """
    tree, lines = _tree(text), text.splitlines()
    for i, node in enumerate(tree.body):
        names = _targets(node)
        value = getattr(node, "value", None)
        if names and value is not None and all(name.isupper() for name in names):
            count = numbers(value)
            if count:
                documented = _documented(tree.body, i, lines)
                yield TunedNumber(module, node.lineno, names, count, documented)
        elif isinstance(node, ast.ClassDef) and node.name.endswith("Settings"):
            if room_of(module) == "config":
                continue
            told = ast.get_docstring(node) or ""
            for j, each in enumerate(node.body):
                names, value = _targets(each), getattr(each, "value", None)
                if names and value is not None and (count := numbers(value)):
                    documented = _documented(node.body, j, lines) or all(
                        re.search(rf"\b{name}\b", told) for name in names
                    )
                    yield TunedNumber(module, each.lineno, names, count, documented)


def class_names_used_twice(modules: dict[Path, str]) -> list[str]:
    """Names that more than one class of the package has."""
    names = Counter(
        node.name
        for text in modules.values()
        for node in _walk(text)
        if isinstance(node, ast.ClassDef)
    )
    return sorted(name for name, count in names.items() if count > 1)


def laws_outside_joints(modules: dict[Path, str]) -> list[str]:
    """Functions that make a force of a place's motion, and joints' subclasses, elsewhere."""
    return [
        f"{module}:{line}"
        for module, text in modules.items()
        if room_of(module) != "joints"
        for line in sorted(node.lineno for node in _walk(text) if _is_law(node))
    ]


def _is_law(node: ast.AST) -> TypeGuard[ast.Lambda | ast.FunctionDef | ast.ClassDef]:
    if isinstance(node, ast.ClassDef):
        bases = map(ast.unparse, node.bases)
        return any(map(_LAWS.fullmatch, bases))
    return isinstance(node, ast.Lambda | ast.FunctionDef) and _reads_motion(node)


def _reads_motion(node: ast.Lambda | ast.FunctionDef) -> bool:
    """Whether a function's first argument is the motion of a place, and it reads that."""
    arguments = node.args.posonlyargs + node.args.args
    if not arguments:
        return False
    first = arguments[0]
    if isinstance(node, ast.FunctionDef):
        if first.annotation is None or ast.unparse(first.annotation) != "PlaceMotion":
            return False
        body: Iterable[ast.AST] = node.body
    else:
        body = [node.body]
    return any(
        isinstance(each, ast.Attribute)
        and each.attr in _MOTION
        and isinstance(each.value, ast.Name)
        and each.value.id == first.arg
        for part in body
        for each in ast.walk(part)
    )


def least_squares_loops(modules: dict[Path, str]) -> list[str]:
    """Modules that solve for steps in a loop of their own, by NumPy or SciPy."""
    return [
        str(module)
        for module, text in modules.items()
        if any(
            isinstance(call, ast.Call) and _SOLVES.search(ast.unparse(call.func))
            for loop in _walk(text)
            if isinstance(loop, ast.For | ast.While)
            for call in ast.walk(loop)
        )
    ]


def parameter_maps(modules: dict[Path, str]) -> list[str]:
    """Modules that know by heart where a vector holds what: ``2 * slot`` and the like."""

    def indexes(node: ast.AST) -> bool:
        if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult)):
            return False
        sides = (node.left, node.right)
        return any(isinstance(s, ast.Constant) and isinstance(s.value, int) for s in sides) and any(
            isinstance(s, ast.Name) and _SLOT.search(s.id) for s in sides
        )

    return [str(m) for m, text in modules.items() if any(map(indexes, _walk(text)))]


def public_names(text: str) -> list[str]:
    """What ``__all__`` of a module lists."""
    for node in _tree(text).body:
        if isinstance(node, ast.Assign) and _targets(node) == ("__all__",):
            return ast.literal_eval(node.value)
    return []


def imported(text: str) -> set[str]:
    """Top-level names of what a source imports, by statement or by a name in a string."""
    found = set()
    for node in _walk(text):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(node.module or "")
        elif isinstance(node, ast.Call) and node.args:
            name, first = ast.unparse(node.func).rpartition(".")[2], node.args[0]
            if name in ("import_module", "importorskip") and isinstance(first, ast.Constant):
                found.add(str(first.value))
    return {name.partition(".")[0] for name in found}


def _notebook(path: Path) -> str:
    """Code of a notebook, without IPython's own commands."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    lines = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code").splitlines()
    return "\n".join(line for line in lines if not line.lstrip().startswith(("%", "!")))


def never_imported(root: Path = ROOT) -> list[str]:
    """Declared dependencies, extras included, that no source, test or notebook imports."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project.get("optional-dependencies", {})
    declared = [
        *project["dependencies"],
        *(each for name, some in extras.items() if name not in _TOOLS for each in some),
    ]
    names = [re.split(r"[\[<>=!~ ;]", each)[0].lower() for each in declared]
    wanted = {name: _IMPORTED_AS.get(name, name.replace("-", "_")) for name in names}
    unseen = set(wanted.values())
    for text in _code(root):
        # To parse every source takes longer than all counts together.
        if any(module in text for module in unseen):
            unseen -= imported(text)
    return [name for name, module in wanted.items() if module in unseen]


def _code(root: Path) -> Iterator[str]:
    """Every source, test and notebook."""
    for folder in ("iwanjax", "tests"):
        for path in (root / folder).rglob("*.py"):
            yield path.read_text(encoding="utf-8")
    for path in (root / "notebooks").glob("*.ipynb"):
        yield _notebook(path)


def rooms(modules: dict[Path, str]) -> dict[str, Room]:
    """Every room's modules (``__init__`` not counted) and tuned numbers."""
    found = {}
    for room in sorted({room_of(module) for module in modules}):
        own = {m: t for m, t in modules.items() if room_of(m) == room}
        lines = {m: t.count("\n") for m, t in own.items() if m.name != "__init__.py"}
        longest = max(lines, key=lambda m: lines[m], default=Path())
        tuned = [each for m, t in own.items() for each in tuned_numbers(m, t)]
        found[room] = Room(
            len(lines),
            lines.get(longest, 0),
            str(longest),
            sum(each.literals for each in tuned),
            sum(each.literals for each in tuned if not each.documented),
        )
    return found


@cache
def counts(root: Path = ROOT) -> dict[str, tuple[int, str]]:
    """Each count of :data:`BOUNDS`, and what is counted, in short."""
    modules = sources(root)
    tuned = [each for m, t in modules.items() for each in tuned_numbers(m, t)]
    bare = [each for each in tuned if not each.documented]
    listed = {
        "class names used twice": class_names_used_twice(modules),
        "laws outside joints": laws_outside_joints(modules),
        "least-squares loops of the host": least_squares_loops(modules),
        "modules that index a parameter map": parameter_maps(modules),
        "declared, never imported": never_imported(root),
    }
    found = {name: (len(each), ", ".join(each)) for name, each in listed.items()}
    found["tuned numbers"] = (sum(each.literals for each in tuned), "")
    where = ", ".join(f"{each.module}:{each.line}" for each in bare)
    found["tuned numbers without a comment"] = (sum(each.literals for each in bare), where)
    found["public names"] = (len(public_names(modules[Path("__init__.py")])), "")
    return {name: found[name] for name in BOUNDS}


def risen(root: Path = ROOT) -> list[str]:
    """Counts above their bounds, one sentence each."""
    found = [
        f"{name}: {count}, bound {BOUNDS[name]}: {what}".rstrip(": ")
        for name, (count, what) in counts(root).items()
        if count > BOUNDS[name]
    ]
    for name, room in rooms(sources(root)).items():
        modules, longest = MODULES.get(name), LONGER.get(name, MOST_LINES)
        if modules is not None and room.modules > modules:
            found.append(f"{name}: {room.modules} modules, bound {modules}")
        if room.longest > longest:
            found.append(f"{room.longest_name}: {room.longest} lines, bound {longest}")
    return found


def table(root: Path = ROOT) -> str:
    """All counts beside their bounds, for people."""

    def against(count: int, bound: int | None) -> str:
        return f"{count}" if bound is None else f"{count} <= {bound}"

    lines = [f"{'room':<13}{'modules':>11}{'longest':>13}{'tuned':>7}{'bare':>6}  longest module"]
    for name, room in rooms(sources(root)).items():
        modules, longest = MODULES.get(name), LONGER.get(name, MOST_LINES)
        lines.append(
            f"{name:<13}{against(room.modules, modules):>11}{against(room.longest, longest):>13}"
            f"{room.tuned:>7}{room.undocumented:>6}  {room.longest_name}"
        )
    lines.append("")
    for name, (count, what) in counts(root).items():
        shown = what if len(what) < 150 else what[:147] + "..."
        lines.append(f"{name:<36}{against(count, BOUNDS[name]):>12}  {shown}".rstrip())
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
    above = risen()
    if above:
        print("\nRisen above their bounds:", *above, sep="\n  ")
    sys.exit(bool(above))
