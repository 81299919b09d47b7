"""Correction of spindle growth as a file for a machine's control (`kerf thermal-growth`)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.app.fleet import DATA, machine_parameters
from pipeline.app.programs import model_lines, passed_status, stored_model
from pipeline.schema.files import replacing
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.cases import Records
from pipeline.submodels.contract import judging_of
from pipeline.submodels.deformation.control_text import (
    CONTROLS,
    Written,
    control_lines,
    table_lines,
)
from pipeline.submodels.deformation.methods import PERSISTENCE
from pipeline.submodels.deformation.model import GrowthModel, load_growth_model
from pipeline.submodels.deformation.records import GROWTH as QUANTITY
from pipeline.submodels.deformation.records import State
from pipeline.submodels.deformation.submodel import SUBMODEL
from pipeline.submodels.deformation.thermal_growth import correction

FORMATS = ("csv", *CONTROLS)
"""Kinds of file."""


def write_thermal_growth(
    machine: str, out: Path, kind: str = "csv", model: str = "champion", *, anyway: bool = False
) -> Written:
    """Write a machine's correction of spindle growth.

    ``anyway``: even when the model failed or was not judged.
    """
    if kind not in FORMATS:
        raise ValueError(f"--format {kind} is not known: name csv, fanuc or siemens")
    parameters = machine_parameters(machine)
    folder = stored_model(machine, model, SUBMODEL)
    growth = load_growth_model(folder)
    status = _judged(folder, anyway=anyway)
    file = growth.file
    done = Written(
        machine=machine, origin=file.origin, method=file.compared[file.champion].label,
        status=status, correction=correction(growth, _training(machine, parameters, growth)),
        models=folder, unknown=next(iter(SUBMODEL.unknown_columns(folder).values()), ""),
    )  # fmt: skip
    lines = table_lines(done) if kind == "csv" else control_lines(done, CONTROLS[kind])
    with replacing(out) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return done


def _judged(folder: Path, *, anyway: bool) -> str:
    """Status of the verdict; always refused where no correction at all errs less."""
    path = folder / "verdict.json"
    verdict = read_json(path, Verdict) if path.exists() else None
    total = None if verdict is None else verdict.total(QUANTITY)
    still = None if total is None else total.baselines.get(PERSISTENCE)
    if total and still and (total.rmse or 0.0) >= (still.rmse or 0.0) > 0:
        raise ValueError(
            f"the growth model in {folder} errs by {total.rmse:.4g} um RMS, a machine without "
            f"correction by {still.rmse:.4g} um: its correction is not written, with --anyway "
            "neither; mend the sensors that it names, or record more speed profiles"
        )
    return passed_status(folder, "growth model", "write its correction", anyway=anyway)


def _training(machine: str, parameters: dict[str, Any], growth: GrowthModel) -> list[State]:
    settings = judging_of(SUBMODEL, parameters, machine)
    learnt = {one.case for one in growth.file.trained_on}
    cases = SUBMODEL.cases(Records(signals=DATA / "signals" / machine), settings).cases
    return [one.load().state for one in cases if one.name in learnt]


def said(done: Written, out: Path, kind: str) -> Iterator[str]:
    """Report of ``kerf thermal-growth`` in lines."""
    found = done.correction
    below, above = found.interval_um
    head = f"{done.machine}{done.simulated}: growth by {done.method}"
    yield from model_lines(head, done.models.parent, done.status, "growth model")
    yield "the offset to add along +Z, away from the workpiece, is +growth"
    yield (
        f"{'exact' if found.exact else 'linearised'}: at most {found.largest_um:.2g} um from the "
        f"model over {found.recordings} training recordings, growth {found.growth_um[0]:.0f} to "
        f"{found.growth_um[1]:.0f} um"
    )
    yield done.unknown or f"90 % interval of the growth: -{below:.1f} to +{above:.1f} um"
    for name in found.inputs:
        one = found.ranges[name]
        yield f"  {name:<22} {one.low:>8g} to {one.high:<8g} {one.unit}"
    yield f"wrote {len(found.terms) + len(found.starts)} terms to {out} ({kind})"
