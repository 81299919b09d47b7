"""Transfer of a golden machine's spindle parameters to a sibling (`kerf transfer`)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.app.fleet import CONF, DATA, machine_parameters, outside_fleet
from pipeline.app.output import check_outputs, label
from pipeline.app.page_record import made_by_command
from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band
from pipeline.charts.numbers import NARROW, as_stated, counted, day_list, fixed, joined
from pipeline.charts.sections import Figure, Figures, Section
from pipeline.charts.sources import Source
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.parameters import structure
from pipeline.report.provenance import UNKNOWN, Made
from pipeline.report.standalone_page import StandalonePage, rendered, source_of
from pipeline.schema.arrays import Floats
from pipeline.schema.files import together
from pipeline.schema.golden import read_golden
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import read_json, write_json
from pipeline.submodels.cases import Records
from pipeline.submodels.contract import settings_of
from pipeline.submodels.spindle.fit import sensor_step
from pipeline.submodels.spindle.submodel import SUBMODEL, Fitting, pieces_of
from pipeline.submodels.spindle.transfer import Transfer, TransferPoint, TransferSettings, transfer
from pipeline.twin.spindle import TARGET, SpindleModelFile

TOP, HEIGHT = 26.0, 250.0
"""Place of the curves below the figure's upper edge, and their height [px]."""
MOST_DAYS = 7
"""Days judged that are named one by one [1]."""
NONE_LEADS = "None of the three"
"""Beginning of a transfer's sentence where no parameters lead."""


def transfer_curve(
    machine: str,
    golden: str,
    out: Path,
    between: float = 0.3,
    page: Path | None = None,
) -> Transfer:
    """Write the curve of minutes of warm-up against error of the sibling ``machine`` into ``out``.

    ``golden``: the machine whose parameters are the prior, pooled with those of further
    machines of its type whose models are stored; ``between``: standard deviation of the logarithm
    of a parameter between machines of a type, as expected before their models are seen [1].
    """
    if machine == golden:
        raise ValueError(f"{machine} is both sibling and golden machine: name another one")
    values = machine_parameters(machine)
    theirs = machine_parameters(golden)
    path = DATA / "models" / golden / SUBMODEL.name / "model.json"
    manifest, clean = DATA / "signals" / machine / "manifest.json", DATA / "clean" / machine
    sets = DATA / "golden" / f"{machine}.json"
    check_outputs(None, out, page, inputs=[path, manifest, sets, *sorted(clean.rglob("*.parquet"))])
    for file, whose, stage in ((path, golden, f"identify_{SUBMODEL.name}"),
                               (manifest, machine, "ingest")):  # fmt: skip
        if not file.exists():
            needed = outside_fleet(whose) or f"run `dvc repro {stage}@{whose}`"
            raise ValueError(f"{file} does not exist: {needed}")
    model = read_json(path, SpindleModelFile)
    settings = settings_of(Fitting, values, machine)
    fitting = settings.spindle_fit
    siblings = _siblings(_identity(theirs, golden).type, model, {machine, golden})
    model = replace(model, records=_shared(model, settings, machine))
    records = Records(manifest=manifest, clean=clean)
    cases = SUBMODEL.cases(records, settings, read_golden(sets))
    training = sorted(cases.of("training"), key=lambda case: case.name)
    measured = np.concatenate(
        [case.load()[TARGET].to_numpy(float) for case in training] or [np.empty(0)]
    )
    origins = (model.origin, settings.identity.origin)
    found = transfer(
        model, machine, "simulated" if "simulated" in origins else "recorded",
        pieces_of(training, model.records, fitting),
        pieces_of(cases.of("held_out", "golden"), model.records, fitting, bridge_s=np.inf),
        own=settings.spindle, resolution_K=sensor_step(measured), fitting=fitting,
        settings=TransferSettings(between_machines=between), siblings=siblings,
    )  # fmt: skip
    with together():
        write_json(found, out)
        if page is not None:
            sources = [source_of(one) for one in (out, path, manifest)]
            credits = [_credit(values, machine), _credit(theirs, golden)]
            credit = "; ".join(dict.fromkeys(one for one in credits if one))
            read = [path, manifest, sets, *sorted(clean.rglob("*.parquet"))]
            made = made_by_command(golden, path.parents[1], values["machine"][machine], read)
            write_transfer_page(found, page, sources, credit, made)
    return found


def _siblings(kind: str, model: SpindleModelFile, without: set[str]) -> list[SpindleModelFile]:
    """Models of further machines of a type that are stored, with a network of that structure."""
    found = []
    for path in sorted((DATA / "models").glob(f"*/{SUBMODEL.name}/model.json")) if kind else ():
        name = path.parts[-3]
        if name in without or not (CONF / f"machine/{name}.yaml").exists():
            continue
        if _identity(machine_parameters(name), name).type == kind:
            found.append(read_json(path, SpindleModelFile))
    return [one for one in found if SUBMODEL.alike(one) == SUBMODEL.alike(model)]


def _identity(values: dict[str, Any], machine: str) -> MachineIdentity:
    return structure(values, f"machine.{machine}.identity", MachineIdentity)


def _credit(values: dict[str, Any], machine: str) -> str:
    return _identity(values, machine).credit.strip().removesuffix(".")


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
    lines = [
        f"{result.machine}{label(result.origin)} from {_golden(result)}: RMSE over free runs of "
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


def _golden(result: Transfer) -> str:
    """The golden machine, and those that are pooled with it."""
    beside = f", pooled with {joined(result.siblings)}" if result.siblings else ""
    return f"{result.golden}{beside}"


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """CSS class of a curve and of its points; its parameters in words, and where they lead."""

    curve: str
    point: str
    words: str
    leads: str


DRAWN = {
    "own": Drawn(
        curve="before", point="p-before", words="own record only", leads="own record leads"
    ),
    "golden": Drawn(
        curve="batch", point="p-knee", words="golden machine’s, as they are", leads="golden leads"
    ),
    "pooled": Drawn(curve="after", point="p-after", words="pooled from both", leads="pooled leads"),
}
"""Parameters by their name in a :class:`TransferPoint`, the uppermost curve last."""


def write_transfer_page(
    result: Transfer, out: Path, sources: Sequence[Source] = (), credit: str = "",
    made: Made = UNKNOWN,
) -> None:  # fmt: skip
    """Write the page of a transfer."""
    rendered(transfer_page(result, sources, credit), out.name, made).write(out)


def transfer_page(result: Transfer, sources: Sequence[Source], credit: str = "") -> StandalonePage:
    """Who leads, figure and table of the curve, what could not be transferred."""
    status, word = _verdict(result)
    sections = [_curve_section(result, sources), _lacking_section(result), _basis_section(result)]
    return StandalonePage(
        program=f"Spindle parameters from {result.golden}",
        machine=result.machine,
        about=f"Kerf: spindle temperature of {result.machine} predicted from its first minutes of "
        f"warm-up, with and without the golden machine {result.golden}",
        origin="simulated" if result.origin == "simulated" else "recorded",
        status=status,
        word=word,
        sentences=[result.sentence.replace("'", "’")],
        key_figures=_key_figures(result),
        sections=[section for section in sections if section is not None],
        credit=credit,
    )


def _verdict(found: Transfer) -> tuple[str, str]:
    """Status and word of the parameters that lead, by the transfer's sentence and least error."""
    if found.sentence.startswith(NONE_LEADS):
        return "unknown", "none leads"
    last = found.points[-1]
    errors = {name: getattr(last, name) for name in DRAWN}
    leader = min(DRAWN, key=lambda name: np.inf if errors[name] is None else errors[name])
    return "passed" if leader == "pooled" else "attention", DRAWN[leader].leads


def _key_figures(found: Transfer) -> list[tuple[str, str, str]]:
    last = found.points[-1]
    after = f"RMSE after {_minutes(last)}{NARROW}min"
    errors = [
        (one.words.capitalize(), _kelvin(getattr(last, name)), after)
        for name, one in reversed(DRAWN.items())
    ]
    step = f"{as_stated(found.resolution_K)}{NARROW}K"
    return [*errors, ("Step of the sensor", step, "a lead is more than this")]


def _curve_section(found: Transfer, sources: Sequence[Source]) -> Section:
    judged = counted(len(found.days_judged), "day")
    legend = [(f"l-{one.curve}", one.words, "line") for one in reversed(DRAWN.values())]
    caption = (
        f"Error of {found.machine}’s spindle temperature against minutes of its own warm-up: RMSE "
        f"over free runs of {judged} that no parameter saw. Each length of the record is one fit; "
        "the axis of minutes is logarithmic."
    )
    figure = Figure(svg=curve_figure(found), caption=caption, sources=list(sources))
    table = transfer_rows(found, f"RMSE over free runs of {judged} not used", sources)
    return Section(
        key="curve", title="Minutes of warm-up against error",
        text=[
            f"Pooled parameters start at those of {_golden(found)}, and are moved by what "
            f"{found.machine}’s record shows. Beside them stand parameters of that record only, "
            f"and those of {found.golden} as they are."
        ],
        blocks=[Figures(figures=[figure], legend=legend, kind="one"), table],
    )  # fmt: skip


def curve_figure(result: Transfer) -> Markup:
    """A curve with its points for each of the pooled, own and golden parameters."""
    values = {name: _errors(result.points, name) for name in DRAWN}
    into, across = band(TOP, HEIGHT, *values.values(), zero=True), _across(result.points)
    into = Band(top=into.top, height=into.height, low=0.0, high=into.high)
    curves = [
        svg.curve(UNITS * across / 100, into.down(values[name]), one.curve)
        for name, one in DRAWN.items()
    ]
    dots = [
        svg.tag("circle", cx=f"{x:.2f}%", cy=into.pixel(y), r=4, class_=f"point {one.point}")
        for name, one in DRAWN.items()
        for x, y in zip(across.tolist(), values[name].tolist(), strict=True)
        if np.isfinite(y)
    ]
    parts = [
        svg.text(0, TOP - 10, "RMSE, K", "head"),
        *into.levels(5), *_minutes_axis(result.points, across, into.bottom),
        into.content(curves), *dots,
    ]  # fmt: skip
    label = f"Error of {result.machine} against minutes of warm-up. {result.sentence}"
    return svg.figure(parts, height=into.bottom + 40, label=label, kind="golden")


def _errors(points: Sequence[TransferPoint], name: str) -> Floats:
    """Errors (N,) of one kind of parameters [K], NaN where there are none."""
    return np.array([getattr(one, name) for one in points], float)


def _across(points: Sequence[TransferPoint]) -> Floats:
    """Place of each point (N,) along the logarithm of the minutes [% of the width]."""
    logs = np.log([one.minutes for one in points])
    span = float(np.ptp(logs))
    return 100 * (logs - logs[0]) / span if span else np.full(len(logs), 50.0)


def _minutes_axis(points: Sequence[TransferPoint], across: Floats, bottom: float) -> list[Markup]:
    parts = [svg.text(50, bottom + 34, "Warm-up, min", "tick mid")]
    for one, x in zip(points, across.tolist(), strict=True):
        parts += [svg.down(x, TOP, bottom), svg.text(x, bottom + 17, _minutes(one), "tick mid")]
    return parts


def transfer_rows(result: Transfer, caption: str, sources: Sequence[Source]) -> Table:
    """A row for each length of the record."""
    columns = [
        Column[TransferPoint]("Warm-up", lambda one: f"{_minutes(one)}{NARROW}min", None),
        Column[TransferPoint]("Pooled", lambda one: fixed(one.pooled, 2), "K"),
        Column[TransferPoint](
            "Own record only", lambda one: "–" if one.own is None else fixed(one.own, 2), "K"
        ),
        Column[TransferPoint]("Golden, as they are", lambda one: fixed(one.golden, 2), "K"),
    ]
    table = tabulated(caption, result.points, columns, sources, note=_gaps(result.points))
    if table is None:
        raise ValueError(
            f"the transfer to {result.machine} has no points: name lengths of a record"
        )
    return table


def _gaps(points: Sequence[TransferPoint]) -> str:
    short = [_minutes(one) for one in points if one.own is None]
    if not short:
        return ""
    return f"The own record alone gives no parameters with {joined(short)} minutes."


def _lacking_section(found: Transfer) -> Section | None:
    if not found.not_transferred:
        return None
    lacking = joined([name.replace("_", " ") for name in found.not_transferred])
    return Section(
        key="lacking", title="What could not be transferred",
        text=[
            f"{found.machine} has heat sources of which nothing is known from {found.golden}: "
            f"{lacking}. Pooling can only put their heat into the other sources."
        ],
    )  # fmt: skip


def _basis_section(found: Transfer) -> Section:
    days = day_list(list(found.days_judged), most=MOST_DAYS)
    return Section(
        key="basis", title="What these numbers rest on",
        text=[
            f"Judged were free runs of {counted(len(found.days_judged), 'day')} of "
            f"{found.machine}: {days}. Its sensor shows steps of "
            f"{as_stated(found.resolution_K)}{NARROW}K: a smaller difference is none, and a lead "
            "counts only if it holds at all longer records too."
        ],
        closing=True,
    )  # fmt: skip


def _minutes(point: TransferPoint) -> str:
    return as_stated(point.minutes)


def _kelvin(value: float | None) -> str:
    return "not known" if value is None else f"{fixed(value, 2)}{NARROW}K"
