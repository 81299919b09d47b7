"""Transfer of a golden machine's spindle parameters to a sibling (`kerf transfer`)."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.fleet import DATA, machine_parameters
from pipeline.app.output import check_outputs
from pipeline.app.transfer_page import write_transfer_page
from pipeline.parameters import section_path, structure
from pipeline.report.standalone_page import source_of
from pipeline.schema.files import together
from pipeline.schema.golden import read_golden
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import read_json, write_json
from pipeline.signals.windows import StateSegment
from pipeline.submodels.cases import Case, Records
from pipeline.submodels.contract import sections
from pipeline.submodels.spindle.fit import sensor_step
from pipeline.submodels.spindle.submodel import SUBMODEL
from pipeline.submodels.spindle.transfer import Transfer, TransferSettings, transfer
from pipeline.twin.spindle import TARGET, SpindleModelFile, SpindleRecords, spindle_stretches


def transfer_curve(
    machine: str,
    golden: str,
    out: Path,
    between: float = 0.3,
    page: Path | None = None,
) -> Transfer:
    """Write the curve of minutes of warm-up against error of the sibling ``machine`` into ``out``.

    ``golden``: the machine whose parameters are the prior; ``between``: standard deviation of the
    logarithm of a parameter between machines of a type [1].
    """
    if machine == golden:
        raise ValueError(f"{machine} is both sibling and golden machine: name another one")
    values = machine_parameters(machine)
    theirs = machine_parameters(golden)
    path = DATA / "models" / golden / SUBMODEL.name / "model.json"
    manifest, clean = DATA / "signals" / machine / "manifest.json", DATA / "clean" / machine
    sets = DATA / "golden" / f"{machine}.json"
    check_outputs(
        None, out, page, inputs=[path, manifest, sets, *sorted(clean.rglob("*.parquet"))]
    )  # fmt: skip
    model = read_json(
        path, SpindleModelFile, f"run `dvc repro identify_{SUBMODEL.name}@{golden}`"
    )  # fmt: skip
    given: dict[str, Any] = {
        name: structure(values, section_path(values, name, machine), kind)
        for name, kind in sections(SUBMODEL.fitting).items()
    }
    settings = SUBMODEL.fitting(**given)
    model = replace(model, records=_shared(model, settings, machine))
    records = Records(manifest=manifest, clean=clean)
    cases = SUBMODEL.cases(records, settings, read_golden(sets))
    training = sorted(cases.of("training"), key=lambda case: case.name)

    def pieces(chosen: list[Case], bridge_s: float) -> list[StateSegment]:
        fitting = settings.spindle_fit
        return _pieces(chosen, model.records, fitting.step_s, bridge_s, fitting.shortest_s)

    measured = np.concatenate(
        [case.load()[TARGET].to_numpy(float) for case in training] or [np.empty(0)]
    )
    origins = (model.origin, settings.identity.origin)
    found = transfer(
        model, machine, "simulated" if "simulated" in origins else "recorded",
        pieces(training, settings.spindle_fit.bridge_s),
        pieces(list(cases.of("held_out", "golden")), np.inf),
        own=settings.spindle, resolution_K=sensor_step(measured), fitting=settings.spindle_fit,
        settings=TransferSettings(between_machines=between),
    )  # fmt: skip
    with together():
        write_json(found, out)
        if page is not None:
            sources = [source_of(one) for one in (out, path, manifest)]
            credits = [_credit(values, machine), _credit(theirs, golden)]
            credit = "; ".join(dict.fromkeys(one for one in credits if one))
            write_transfer_page(found, page, sources, credit)
    return found


def _pieces(
    chosen: list[Case], records: SpindleRecords, step: float, bridge_s: float, shortest_s: float
) -> list[StateSegment]:
    return [
        piece
        for case in chosen
        for piece in spindle_stretches(
            case.load(), case.name, records, step=step, bridge_s=bridge_s, shortest_s=shortest_s
        )
    ]


def _credit(values: dict[str, Any], machine: str) -> str:
    identity = structure(values, f"machine.{machine}.identity", MachineIdentity)
    return identity.credit.strip().removesuffix(".")


def _shared(model: SpindleModelFile, settings: Any, machine: str) -> Any:
    theirs, own = model.records, settings.spindle
    for name in ("ambient", "coolant"):
        if getattr(theirs, name) and not getattr(own, name):
            raise ValueError(
                f"{model.machine} was identified with {name}_temperature, which {machine} does not "
                "record: take another golden machine, or record it"
            )
    held = theirs.position_control and own.position_control
    return replace(theirs, position_control=held, extra=())


def transfer_table(result: Transfer) -> list[str]:
    """The curve as lines of a table, with its sentence."""
    simulated = f" ({result.origin})" if result.origin == "simulated" else ""
    lines = [
        f"{result.machine}{simulated} from {result.golden}: RMSE over free runs of "
        f"{len(result.days_judged)} {'day' if len(result.days_judged) == 1 else 'days'} not used "
        "[K]",
        f"{'warm-up, min':>12}  {'pooled':>8}  {'own only':>8}  {'golden':>8}",
    ]
    for one in result.points:
        own = "-" if one.own is None else f"{one.own:.2f}"
        lines.append(f"{one.minutes:>12g}  {one.pooled:>8.2f}  {own:>8}  {one.golden:>8.2f}")
    lacking = [
        f"Nothing is known from {result.golden} of these heat sources: "
        f"{', '.join(result.not_transferred)}."
    ]
    return [*lines, result.sentence, *(lacking if result.not_transferred else [])]
