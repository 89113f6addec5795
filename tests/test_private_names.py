"""Tests go through public names: what a test needs of a room, another room may need as well.

A name with one underscore in front belongs to its module, and changes without notice. Counted are
imports from the package, attributes of its modules, and names given to ``monkeypatch`` as strings.
"""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
PRIVATE = re.compile(r"_(?!_)")
# Python's and IPython's own, private by spelling only.
PROTOCOLS = {"_asdict", "_field_defaults", "_fields", "_make", "_replace", "_repr_html_"}
PATCHES = {"setattr", "delattr", "setitem"}


def private(name: str) -> bool:
    """Whether any part of a dotted name is private."""
    return any(PRIVATE.match(part) and part not in PROTOCOLS for part in name.split("."))


def is_package(name: str | None) -> bool:
    return (name or "").split(".")[0] == "iwanjax"


def private_names(source: str) -> list[str]:
    """Private names of iwanjax in the source of a test, in order."""
    tree, modules, found = ast.parse(source), set(), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias for alias in node.names if is_package(alias.name)]
            modules |= {alias.asname or alias.name.split(".")[0] for alias in names}
            found += [(node.lineno, alias.name) for alias in names if private(alias.name)]
        elif isinstance(node, ast.ImportFrom) and is_package(node.module):
            modules |= {alias.asname or alias.name for alias in node.names}
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found += [(node.lineno, name) for name in names if private(name)]
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and private(node.attr):
            base: ast.expr = node.value
            while isinstance(base, ast.Attribute):
                base = base.value
            # A test's own classes keep what they like; what comes from a call may be the package's.
            if not (isinstance(base, ast.Name) and base.id in {"self", "cls"}):
                found.append((node.lineno, node.attr))
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in PATCHES:
            texts = [a.value for a in node.args if isinstance(a, ast.Constant)]
            of_module = bool(node.args) and getattr(node.args[0], "id", "") in modules
            found += [
                (node.lineno, text)
                for text in texts
                if isinstance(text, str) and private(text) and (of_module or is_package(text))
            ]
    return [name for _, name in sorted(found)]


FILES = sorted(path for path in TESTS.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_a_test_uses_public_names(path):
    assert not private_names(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from iwanjax.joints import _power", ["iwanjax.joints._power"]),
        ("from iwanjax._joints import power", ["iwanjax._joints.power"]),
        ("import iwanjax as ij\nij.joints._power(1)", ["_power"]),
        ("from iwanjax import joints\ndef f():\n    return joints._power", ["_power"]),
        ("problem.with_joint()._steps", ["_steps"]),
        ("from iwanjax import joints\nm.setattr(joints, '_power', 1)", ["_power"]),
        ("m.setattr('iwanjax.joints._power', 1)", ["iwanjax.joints._power"]),
    ],
)
def test_a_private_name_is_found(source, found):
    assert private_names(source) == found


@pytest.mark.parametrize(
    "source",
    [
        "from iwanjax.joints import power as _power\n_power(1)",
        "result._replace(x=1)._repr_html_()",
        "import iwanjax\niwanjax.__version__",
        "class A:\n    def f(self):\n        return self._own",
        "m.setattr(own, '_power', 1)",
    ],
)
def test_what_is_public_or_the_tests_own_passes(source):
    assert not private_names(source)
