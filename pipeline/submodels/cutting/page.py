"""Page of the cut: coefficients, their use in maintenance, the spindle's load, forces."""

from collections.abc import Iterator
from typing import Any

from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import NARROW, TOGETHER, counted, joined, number, real
from pipeline.charts.parameters import KnownValue, fit_words
from pipeline.charts.sections import Heading, present
from pipeline.charts.sources import stated
from pipeline.charts.submodel_page import PageContent, declared, made_from
from pipeline.charts.tables import Column, code, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.cutting import (
    CHANNEL_FORCE,
    CHANNELS,
    OTHERS,
    PLAIN,
    PLANE,
    SPINDLE,
    CutRecording,
    CuttingModel,
    ResidualConditions,
)
from pipeline.schema.model import Correlation, Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.cutting.spindle_load.page import spindle_load, true_powers

WORDS = page_words(__file__)
TRIED, REMEDIES = WORDS.table("tried"), WORDS.table("remedies")
"""Methods and terms of the model, and meanings of growth beyond both intervals, by parameter."""
MOST_FEEDS = 4
"""Feeds of a set of conditions that are named [1]."""
TURN = 360.0
"""Angle of a spindle revolution [deg]."""

Seen = Shown[CuttingModel]


def content(shown: Seen) -> PageContent:
    """Page content of the cut."""
    model = shown.model
    return declared(
        WORDS,
        cause=_causes(shown),
        facts=[] if model is None else [one for one in _facts(model) if one],
        meaning=lambda group, name: _meaning(model, group, name),
        of_group={} if model is None else {
            "": present(Heading(heading=WORDS("wear.head"), text=WORDS("wear.text"))
                        if model.coefficients else None),
            SPINDLE: present(*spindle_load(shown, model)),
        },
        figures=[] if model is None else [tabulated(
            f"Recordings of the cut ({len(model.recordings)})", model.recordings, RECORDED,
            made_from(shown, "model.json"), folded=True,
        )],
        tried=[] if model is None else list(_tried(model)),
        drawn=[Drawn(
            quantity=PLANE, error="relative_percent", axis="Angle of the spindle, °",
            regime=OTHERS if shown.verdict is None or shown.verdict.judged_role is None else "",
            shown=tuple(f"{CHANNEL_FORCE}{channel}" for channel in CHANNELS),
            other=(PLAIN, WORDS.content["titles"][PLAIN]),
        )],
        truth=list(_truth(shown)) if shown.origin == "simulated" else [],
        changed=wear_note,
    )  # fmt: skip


def _meaning(model: CuttingModel | None, group: str, name: str) -> str:
    """Meaning of a parameter, with its remark."""
    means = WORDS.meaning(group, name)
    remark = "" if model is None or group else model.remarks.get(name, "")
    return f"{means}; {remark}" if remark else means


def wear_note(group: str, name: str, before: Parameter, now: Parameter) -> str:
    """Action on a parameter that grew beyond both intervals; else empty."""
    full = f"{group} {name}".strip()
    remedy, was, new = REMEDIES.get(full, ""), before.interval_95, now.interval_95
    if not remedy or was is None or new is None or new[0] <= was[1]:
        return ""
    return WORDS("wear.grown", name=full, remedy=remedy)


def _causes(shown: Seen) -> str:
    """Explanation of failed recordings: faults, conditions beyond the training data."""
    if shown.verdict is None:
        return ""
    failed = {s.group for s in shown.verdict.scores if s.status == "failed"}
    rows = () if shown.model is None else shown.model.recordings
    said = [WORDS("cause.fault", recording=one.recording, fault=one.fault) for one in rows
            if one.fault and one.recording in failed]  # fmt: skip
    outside = {one.case for one in shown.verdict.outside} & failed
    if outside:
        said.append(WORDS("cause.outside", many=len(outside)))
    return "".join(said)


def _facts(model: CuttingModel) -> Iterator[str]:
    """Tool and material, fit, runout, the learnt part."""
    if not model.coefficients:
        reason = model.reason.rstrip(".")
        yield WORDS("facts.none", reason=reason) if reason else WORDS("facts.no_forces")
    tool = model.tool
    kind = str(tool.get("kind") or "").replace("_", " ")
    diameter, flutes = tool.get("diameter_mm"), tool.get("flutes")
    size = ", ".join(w for w in (f"{diameter:g}{NARROW}mm" if diameter else "",
                                 f"{flutes:g} teeth" if flutes else "") if w)  # fmt: skip
    yield WORDS(
        "facts.tool",
        tool=(f"a {kind} cutter" if kind else "not described") + f" ({size})" * bool(size),
        material=f", the material {model.material}" if model.material else "",
    )
    yield _fitted(model)
    runout = model.coefficients.get("runout")
    if runout is not None and runout.determined:
        yield WORDS("facts.runout", value=number(runout.value))
    rows = model.residual_conditions
    if rows:
        more = f" and {counted(len(rows) - 3, 'more set')} of conditions" if len(rows) > 3 else ""
        where = "; ".join(_conditions(row) for row in rows[:3])
        yield WORDS("facts.learnt", where=f"{where}{more}")


def _fitted(model: CuttingModel) -> str:
    fit = model.fit
    if fit is None:
        return ""
    over = [counted(n, one) for n, one in ((fit.samples, "sample"),
                                           (fit.revolutions, "revolution")) if n]  # fmt: skip
    said = WORDS("facts.fit", error=number(fit.rms_error_percent, 2),
                 over=f" over {' of '.join(over)}" if over else "")  # fmt: skip
    taken = model.prediction
    if taken is not None and taken.line:
        said += WORDS("facts.law", growth=number(1e6 * taken.growth_m, 2),
                      exponent=number(taken.exponent, 2))  # fmt: skip
    names, values = model.correlation.names, model.correlation.values
    kept = [k for k, name in enumerate(names) if name in model.coefficients]
    shown = Correlation(names=tuple(names[k] for k in kept),
                        values=tuple(tuple(values[i][j] for j in kept) for i in kept))  # fmt: skip
    return fit_words(said, fit.condition, shown)


def _conditions(row: ResidualConditions) -> str:
    feeds = sorted(set(row.feeds_per_tooth_mm))
    words = joined([f"{feed:g}" for feed in feeds])
    if len(feeds) > MOST_FEEDS:
        words = f"{len(feeds)} feeds from {feeds[0]:g} to {feeds[-1]:g}"
    low, high = row.holds_for_mm
    return (
        f"{number(round(row.speed_rpm))}{TOGETHER}rev/min, {row.axial_depth_mm:g}{TOGETHER}mm "
        f"deep, learnt at {words}{TOGETHER}mm per tooth, used from {low:g} to {high:g}"
    )


def _tried(model: CuttingModel) -> Iterator[Tried]:
    """Optimisers on the same waveforms, and terms of the model on held-out recordings."""
    for row in model.methods:
        yield Tried(task="search", label=TRIED.get(row.method, row.method), unit="%",
                    error=row.rms_error_percent, evaluations=row.evaluations,
                    serves=row.method == model.method)  # fmt: skip
    several = [one.role for one in model.recordings].count("training") != 1
    for term in model.terms:
        label = ", ".join(TRIED.get(one, one) for one in term.terms) or "coefficients alone"
        yield Tried(task="terms beside the coefficients", label=label, serves=term.kept,
                    error=100 * term.value if several else term.value,
                    unit="%" if several else "criterion")  # fmt: skip


RECORDED: tuple[Column[CutRecording], ...] = (
    Column("Recording", lambda one: code(one.recording)),
    Column("use", lambda one: "learnt from" if one.role == "training" else one.role),
    Column("revolutions", lambda one: number(one.revolutions), ""),
    Column("what was done to it, or why not",
           lambda one: one.reason or one.fault or "; ".join(one.notes) or "–"),
)  # fmt: skip


def _truth(shown: Seen) -> Iterator[KnownValue]:
    """Coefficients, runout, specific force and no-load powers of what stands in both."""
    model, truth = shown.model, stated(shown.truth, "cutting")
    if model is None:
        return
    flutes = real(model.tool.get("flutes")) or 1.0
    found, of_load = dict(model.coefficients), model.spindle_parameters
    stored = stated(truth, "parameters")
    values: dict[str, Any] = dict(stored) if isinstance(stored, dict) else {}
    if "specific_force" in of_load:
        found["specific_force"] = of_load["specific_force"]
        values["specific_force"] = stated(truth, "spindle", "specific_force")
    for name, value in values.items():
        true = real(value.get("value") if isinstance(value, dict) else value)
        if true is not None and name in found:
            period = TURN / max(flutes, 1.0) if name == "runout_angle" else 0.0
            yield KnownValue(name=name, true=true, parameter=found[name], period=period)
    yield from true_powers(model, truth)
