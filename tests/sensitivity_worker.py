"""The process that `concealed/sensitivity.py` starts: cases diagnosed with other tuned numbers."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import jax
from concealed.frozen import failed, judged
from concealed.sensitivity import AS_IS, numbers, trials

import iwanjax as ij
from iwanjax.compiler import compile_quickly
from iwanjax.settings.stages import Settings, using
from iwanjax.studies.verdicts import as_json


def diagnosed(case: Path, settings: Any) -> dict[str, Any]:
    """What a record keeps of a case, diagnosed with these settings."""
    start = time.perf_counter()
    try:
        with using(settings):
            study = ij.load_study(case / "study.yaml")
            found = {"study": study.name} | as_json(dict(study.diagnose()))
    # Any value may be one that a diagnosis cannot work with: that is a result as well.
    except Exception as error:
        return failed(case, f"{type(error).__name__}: {error}", time.perf_counter() - start)
    # As a file has it: plain numbers.
    return judged(case, json.loads(json.dumps(found, default=float)), time.perf_counter() - start)


def work(folder: Path, out: Path, only: list[str], stages: list[str] | None) -> None:
    """Diagnose every case with every value that the record does not hold yet."""
    record = json.loads(out.read_text()) if out.exists() else {"kept": {}}
    record["fields"] = {path: [value, unit] for path, value, unit in numbers(Settings())}
    for path, name, settings in trials(Settings(), stages):
        for case in only:
            own = record["kept"].setdefault(path, {}).setdefault(name, {})
            if case in own:
                continue
            found = diagnosed(folder / case, settings)
            if name == AS_IS:
                # Once more: the first time kernels were compiled.
                found = diagnosed(folder / case, settings)
            own[case] = found
            beside = out.with_suffix(".part")
            beside.write_text(json.dumps(record, indent=1))
            beside.replace(out)
            said = found.get("error") or " + ".join(found["said"]) or found["verdict"]
            right = "right" if found["right"] else "WRONG"
            print(f"{path} {name} | {case} | {right} {said} | {found['seconds']:.0f} s", flush=True)


if __name__ == "__main__":
    # As the command does.
    compile_quickly()
    jax.config.update("jax_enable_x64", True)
    task = json.loads(sys.argv[1])
    work(Path(task["folder"]), Path(task["out"]), task["only"], task["stages"])
