"""Every public name has an example in its docstring, and what the examples show is true."""

import doctest
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import iwanjax as ij
from iwanjax.joints.catalogue import JOINTS
from iwanjax.studies import StudyResults

ROOT = Path(__file__).resolve().parents[1]
# Names whose examples need an extra.
EXTRAS = {"brake_reuss_beam": "skfem", "sumali_beam": "skfem"}
# Examples of names one import deeper.
DEEPER = {"StudyResults": StudyResults}
NAMES = {name: getattr(ij, name) for name in ij.__all__} | DEEPER


def example_of(name):
    """The examples in an object's own docstring, without those of its methods."""
    return doctest.DocTestParser().get_doctest(NAMES[name].__doc__ or "", {}, name, None, 0)


@pytest.fixture
def at_root(monkeypatch):
    """Examples are run beside configs/ and leave no joint, figure or file behind."""
    monkeypatch.chdir(ROOT)
    joints, files = dict(JOINTS), set(ROOT.iterdir())
    yield
    JOINTS.clear()
    JOINTS.update(joints)
    plt.close("all")
    assert set(ROOT.iterdir()) == files


@pytest.mark.parametrize(
    "name",
    # A front takes 17 s to compile; updating/test_trade_offs.py has one by default.
    [pytest.param(n, marks=pytest.mark.long) if n == "pareto_front" else n for n in NAMES],
)
@pytest.mark.usefixtures("at_root")
def test_the_example_is_true(name):
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name])
    example = example_of(name)
    report: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=report.append)
    assert not report, "".join(report)


@pytest.mark.parametrize("name", NAMES)
def test_there_is_an_example_that_ends_in_a_result(name):
    examples = example_of(name).examples
    assert examples, f"{name} has no example in its docstring"
    assert examples[-1].want, f"the example of {name} shows no result"
    assert sum(each.source.count("\n") for each in examples) <= 15
