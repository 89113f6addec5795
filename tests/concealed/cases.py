"""The concealed cases with the sizes of their effects, less those that were refused."""

import json
from dataclasses import replace
from pathlib import Path

from concealed.plan import Case, plan

from iwanjax.trial.effects import Effect

SIZES = Path(__file__).with_name("sizes.json")


def _sized(case: Case, table: dict[str, list[dict] | str]) -> Case | None:
    """Put the sizes of the table into a case, checking that they belong to its effects.

    None for one that was refused: the table then holds why.
    """
    if not case.wanted:
        return case
    found = table.get(str(case.number), [])
    if isinstance(found, str):
        return None
    if [(f["kind"], f["where"]) for f in found] != [w[:2] for w in case.wanted]:
        raise ValueError(
            f"{SIZES.name} does not hold case {case.number} ({case.wanted}): "
            f"run sizing.py --only {case.number}"
        )
    effects = tuple(Effect(f["kind"], f["where"], tuple(f["values"])) for f in found)
    return replace(case, effects=effects)


_TABLE: dict[str, list[dict] | str] = json.loads(SIZES.read_text())
CASES: tuple[Case, ...] = tuple(
    case for planned in plan() if (case := _sized(planned, _TABLE)) is not None
)
