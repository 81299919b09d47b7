"""Page of the cut: coefficients, their use in maintenance, the spindle's load, forces."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.charts.bands import Strip, axis, strips_figure
from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import NARROW, TOGETHER, counted, joined, number, real
from pipeline.charts.parameters import KnownValue, fit_words
from pipeline.charts.sections import Block, Figure, Figures, Heading, present
from pipeline.charts.sources import stated
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Column, code, tabulated
from pipeline.schema.cutting import (
    CHANNEL,
    CHANNEL_FORCE,
    CHANNELS,
    MAGNITUDE,
    MEAN_FORCE,
    MECHANICS,
    OTHERS,
    PLAIN,
    PLANE,
    SPINDLE,
    CutRecording,
    CuttingModel,
    NoLoadPoint,
    ResidualConditions,
    SpindleLoad,
)
from pipeline.schema.model import Correlation, Parameter
from pipeline.submodels.contract import Shown

MEANINGS = {
    "K_tc": "cutting, along the cutting speed: grows with material and a blunter rake",
    "K_rc": "cutting, away from the workpiece",
    "K_ac": "cutting, along the tool’s axis",
    "K_te": "edge, along the cutting speed: rubbing, grows as the edge wears",
    "K_re": "edge, away from the workpiece: grows first as flank wear grows",
    "K_ae": "edge, along the tool’s axis",
    "runout": "how far the tool’s axis is off the spindle’s",
    "runout_angle": "where that offset is, from the first tooth on",
    "helix": "helix angle of the edges",
    "kienzle.k_c11": "Kienzle: specific force of a chip 1 mm thick and wide",
    "kienzle.m_c": "Kienzle: how fast the specific force falls with thicker chips",
    "natural_frequency_Hz": "natural frequency of dynamometer and workpiece",
    "damping": "its damping ratio",
    "p0": "no-load power of a spindle that hardly turns",
    "p1": "no-load power that grows with speed",
    "p2": "no-load power that grows with speed squared",
    "specific_force": "power at the tool for each volume of chips in time, edges and all",
}
"""Meaning of the parameters of the cut, for readers."""
OF_LOAD = {
    "K_tc": "of the specific force what grows with the chip",
    "K_te": "of it what the edges take, for each width in the cut",
}
"""Meanings of those parameters that the spindle's load gives too."""
TRIED = {
    "least_squares": "least squares", "genetic": "genetic search", "runout": "runout",
    "helix": "helix angle", "modes": "ringing of the dynamometer’s channels",
    "teeth": "an edge of its own for each tooth",
}  # fmt: skip
"""Methods and terms of the model, in words."""
WEAR = (
    "The edge coefficients are the part of the force that does not depend on the chip, that is "
    "rubbing. Edge coefficients that grow with the same tool, material and depth mean a wearing "
    "edge: measure its flank and change it. Runout that grows means dirt, a worn collet or a bent "
    "shank: clean the taper, clamp the tool anew, check it with a dial gauge. One set of records "
    "cannot say whether either has grown, nor tell a worn edge from a harder batch of material: "
    "cut the same slots again, once with a new edge and then every few weeks, and the list of "
    "changes says what moved."
)
NO_FORCES = (
    "No force was recorded on a dynamometer, so no coefficient of a direction is known: a slot at "
    "three feeds or more, at 10 kHz, gives all of them. Without a dynamometer the load of the "
    "spindle serves: logged with the line of a program of known cuts, and once without a cut, it "
    "gives the specific force."
)
WORN = ("K_te", "K_re", "K_ae", "spindle specific_force", "spindle K_te")
"""Parameters that grow as an edge wears, by group and name."""
REMEDIES = {
    **dict.fromkeys(WORN, "an edge that has worn since, or a harder batch of material: measure "
                          "the flank, and change the edge"),
    "runout": "a tool that no longer runs true: clean the taper, clamp it anew, check it with a "
              "dial gauge",
}  # fmt: skip
"""Meaning of growth beyond both intervals, by parameter."""
MOST_FEEDS, POINTS = 4, 120
"""Feeds of a set of conditions that are named, and points of a curve from coefficients [1]."""
TURN = 360.0
"""Angle of a spindle revolution [deg]."""
SAME = 0.02
"""Share by which the speeds of two levels differ at most [1]."""
POLYNOMIAL = ("p0", "p1", "p2")
"""Coefficients of the no-load power over the speed in rev/s [W], [W s], [W s^2]."""

Seen = Shown[CuttingModel]


def content(shown: Seen) -> PageContent:
    """Page content of the cut."""
    model = shown.model
    return PageContent(
        about="The force on a cutting edge is taken as a cutting coefficient times the area of the "
        "chip plus an edge coefficient times its width, along the cutting speed (t), away from the "
        "workpiece (r) and along the axis (a).",
        rules="The model is given speed, feed, depth and the tool alone. Errors are of the force "
        "in the plane of the feed over one mean revolution: RMS of modelled less measured force as "
        "a share of the measured RMS force; of its largest and of its mean value. Recordings "
        f"“{OTHERS}” are training recordings as a fit without them predicts them: a weaker proof "
        "than a recording of another day or another clamping. The 90 % interval counts the law of "
        "the chip that the records leave open, the coefficients, and errors on recordings left "
        "out; it widens outside of what was learnt. Mean-force coefficients: the plain "
        "guess, without helix, runout or the mode of a channel.",
        case="recording",
        counts=(
            Counting(key="cut_rms_percent", name="Error of cutting forces (RMS)", quantity=PLANE,
                     error="relative_percent", instead=OTHERS),
            Counting(key="cut_peak_percent", name="Error of peak cutting forces",
                     quantity=MAGNITUDE, error="peak_percent", instead=OTHERS),
            Counting(key="cut_mean_percent", name="Error of mean cutting forces",
                     quantity=MAGNITUDE, error="mean_percent", instead=OTHERS),
        ),
        judged_count=("cuts_judged", "Cuts judged"),
        guess=PLAIN,
        titles={PLAIN: "mean-force coefficients",
                MECHANICS: "mechanics alone"},
        todo={
            "passed": "Plan cuts with these forces, with this tool and material.",
            "failed": "Do not plan cuts with these forces; record the failed conditions again with "
            "a new edge and the tool clamped anew.",
            "unknown": "Keep a recording at another feed or depth out of roles.training, to judge "
            "by.",
        },
        cause=_causes(shown),
        facts=[] if model is None else [one for one in _facts(model) if one],
        meaning=lambda group, name: meaning(model, group, name),
        groups={} if model is None else {
            "": "the cut", MEAN_FORCE: "the mean forces alone", SPINDLE: "the spindle’s load",
            **{group: f"{group} of the dynamometer" for group in model.parameters
               if group.startswith(CHANNEL)},
        },
        of_group={} if model is None else {
            "": present(Heading(heading="What maintenance can read from this", text=WEAR)
                        if model.coefficients else None),
            SPINDLE: present(*_spindle(shown, model)),
        },
        figures=[] if model is None else [tabulated(
            f"Recordings of the cut ({len(model.recordings)})", model.recordings, RECORDED,
            made_from(shown, "model.json"), folded=True,
        )],
        tried=[] if model is None else list(_tried(model)),
        tried_where="on the training records, or on those left out",
        drawn=[Drawn(
            quantity=PLANE, error="relative_percent", axis="Angle of the spindle, °",
            regime=OTHERS if shown.verdict is None or shown.verdict.judged_role is None else "",
            shown=tuple(f"{CHANNEL_FORCE}{channel}" for channel in CHANNELS),
            other=(PLAIN, "mean-force coefficients"),
        )],
        shown_facts=("predicted by",),
        truth=list(_truth(shown)) if shown.origin == "simulated" else [],
        truth_note="True coefficients are those of the straight line nearest to the simulated edge "
        "force, which is no straight line. The angle of the runout is determined only up to whole "
        "pitches of the teeth. No-load power, rev/min: at the tool.",
        changed=wear_note,
    )  # fmt: skip


def meaning(model: CuttingModel | None, group: str, name: str) -> str:
    """Meaning of a parameter, with its remark."""
    means = OF_LOAD.get(name) if group == SPINDLE else None
    means = means or MEANINGS.get(name, "–")
    remark = "" if model is None or group else model.remarks.get(name, "")
    return f"{means}; {remark}" if remark else means


def wear_note(group: str, name: str, before: Parameter, now: Parameter) -> str:
    """Action on a parameter that grew beyond both intervals; else empty."""
    full = f"{group} {name}".strip()
    remedy, was, new = REMEDIES.get(full, ""), before.interval_95, now.interval_95
    if not remedy or was is None or new is None or new[0] <= was[1]:
        return ""
    return (
        f"{full} grew by more than both intervals allow: look for {remedy}. "
        "That holds if tool, material and clamping are the same as then."
    )


# ---- the model in words


def _causes(shown: Seen) -> str:
    """Explanation of failed recordings: faults, conditions beyond the training data."""
    if shown.verdict is None:
        return ""
    failed = {s.group for s in shown.verdict.scores if s.status == "failed"}
    rows = () if shown.model is None else shown.model.recordings
    said = [f" In {one.recording} {one.fault}." for one in rows
            if one.fault and one.recording in failed]  # fmt: skip
    outside = {one.case for one in shown.verdict.outside} & failed
    if outside:
        said.append(f" {len(outside)} of those that failed lie outside of what was learnt: name "
                    "such recordings in roles.training too.")  # fmt: skip
    return "".join(said)


def _facts(model: CuttingModel) -> Iterator[str]:
    """Tool and material, fit, runout, the learnt part."""
    if not model.coefficients:
        reason = model.reason.rstrip(".")
        yield f"No coefficient of the cut could be found: {reason}." if reason else NO_FORCES
    tool = model.tool
    kind = str(tool.get("kind") or "").replace("_", " ")
    diameter, flutes = tool.get("diameter_mm"), tool.get("flutes")
    size = ", ".join(w for w in (f"{diameter:g}{NARROW}mm" if diameter else "",
                                 f"{flutes:g} teeth" if flutes else "") if w)  # fmt: skip
    yield (
        f"The tool is {f'a {kind} cutter' if kind else 'not described'}{f' ({size})' * bool(size)}"
        f"{f', the material {model.material}' if model.material else ''}."
    )
    yield _fitted(model)
    runout = model.coefficients.get("runout")
    if runout is not None and runout.determined:
        yield (
            f"In these records the tool’s axis was {number(runout.value)}{NARROW}µm off the "
            "spindle’s."
        )
    rows = model.residual_conditions
    if rows:
        more = f" and {counted(len(rows) - 3, 'more set')} of conditions" if len(rows) > 3 else ""
        yield (
            "Beside mechanics the model holds what mechanics leave over, by the angle of the "
            "spindle; affine in the feed. That part was learnt, not understood, and is used only "
            f"where it was learnt: {'; '.join(_conditions(row) for row in rows[:3])}{more}. Under "
            "any other conditions mechanics alone predict."
        )


def _fitted(model: CuttingModel) -> str:
    fit = model.fit
    if fit is None:
        return ""
    over = [counted(n, one) for n, one in ((fit.samples, "sample"),
                                           (fit.revolutions, "revolution")) if n]  # fmt: skip
    said = f"The residual of the fit is {number(fit.rms_error_percent, 2)} % of the RMS force"
    said += f" over {' of '.join(over)}" if over else ""
    taken = model.prediction
    if taken is not None and taken.line:
        said += (
            f"; forces are predicted by a law whose edge force grows over "
            f"{number(1e6 * taken.growth_m, 2)} µm of chip, with a size effect of exponent "
            f"{number(taken.exponent, 2)}"
        )
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


# ---- the spindle's load

LOGS: tuple[Column[tuple[str, str, str]], ...] = (
    Column("Log", lambda row: code(row[0])), Column("use", lambda row: row[1]),
    Column("what of it is not used, or why not", lambda row: row[2]),
)  # fmt: skip


def _spindle(shown: Seen, model: CuttingModel) -> list[Block | None]:
    """Heading, no-load power and logs of the spindle's load."""
    spindle = model.spindle
    if spindle is None:
        return []
    notes = [note.partition(": ") for note in spindle.notes]
    rows = [(name, "used", "; ".join(words for log, _, words in notes if log == name) or "–")
            for name in spindle.recordings]  # fmt: skip
    rows += [(lost.case, "left out", lost.reason.removeprefix(f"{lost.case} "))
             for lost in spindle.left_out]  # fmt: skip
    logs = tabulated(f"Logs of the spindle’s load ({len(rows)})", rows, LOGS,
                     made_from(shown, "model.json"), folded=True)  # fmt: skip
    head = Heading(heading="Power of the spindle", text=_spindle_words(model, spindle))
    return [head, _no_load(shown, model, spindle), logs]


def _spindle_words(model: CuttingModel, spindle: SpindleLoad) -> str:
    """Results from the spindle load, and their use."""
    in_table = {lost.reason for lost in spindle.left_out}
    reason = "; ".join(one for one in spindle.reason.split("; ") if one not in in_table)
    ends = [words.rstrip(".") for words in (spindle.assumed, reason)]
    rest = "".join(f" {words[0].upper()}{words[1:]}." for words in ends if words)
    specific = model.spindle_parameters.get("specific_force")
    if specific is None or not specific.determined:
        return f"From the load that the control shows no specific force could be had.{rest}"
    watts = number((specific.value or 0.0) / 60)  # N/mm^2 as power for a rate [W min/cm^3]
    return (
        f"From the load that the control shows each cm³ of chips a minute takes {watts}{NARROW}W "
        "at the tool: no dynamometer is needed to watch this one number, and it grows as the edge "
        f"wears, with thin chips most.{rest}"
    )


def _no_load(shown: Seen, model: CuttingModel, spindle: SpindleLoad) -> Figures | None:
    """No-load power over speed: measured levels, fitted curve and its band."""
    points = sorted(spindle.curve, key=lambda one: one.speed_rpm)
    at, fitted, half, measured = np.array([
        (one.speed_rpm, one.power_W, one.half_width_95_W, one.measured_W) for one in points
    ], dtype=np.float64).reshape(-1, 4).T  # fmt: skip
    powers = [model.spindle_parameters[name].value for name in POLYNOMIAL
              if name in model.spindle_parameters]  # fmt: skip
    known = [value for value in powers if value is not None]
    curves, ends = [], spindle.range_rpm
    if ends is not None and ends[0] < ends[1] and known and len(known) == len(powers):
        speed = np.linspace(*ends, POINTS)
        power = np.polynomial.polynomial.polyval(speed / 60.0, known)
        curves = [("modelled", speed, np.asarray(power, np.float64))]
    if not curves and not len(at):
        return None
    strip = Strip(
        head="No-load power, W", height=220, zero=True, curves=curves,
        areas=[("s-band", at, fitted - half, fitted + half)] if len(at) > 1 else [],
        dots=[("p-positive", at, measured)] if len(at) else [],
    )  # fmt: skip
    top = float(max([1.0, *at.tolist(), *([ends[1]] if ends else [])]))
    words = f"Power of the spindle without a cut, {counted(len(points), 'level')} of speed."
    svg = strips_figure([strip], axis("Speed, rev/min", (0.0, top)), words)
    figure = Figure(svg=svg, caption=words, sources=made_from(shown, "model.json"))
    legend = [("p-positive", "measured", "dot"), ("l-modelled", "fitted curve", "line"),
              ("s-band", "its 95 % band", "box")]  # fmt: skip
    return Figures(figures=[figure], legend=legend, kind="one")


# ---- the truth of a simulated machine


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
    yield from _true_powers(model, truth)


def _true_powers(model: CuttingModel, truth: Any) -> Iterator[KnownValue]:
    """True no-load power at the tool at the simulated speeds; the truth is the motor's."""
    spindle, pairs = model.spindle, stated(truth, "spindle", "no_load_W")
    if spindle is None or not spindle.curve or not isinstance(pairs, list):
        return
    efficiency = real(stated(truth, "spindle", "efficiency")) or 1.0
    for speed, power in pairs:
        near: NoLoadPoint = min(spindle.curve, key=lambda one: abs(one.speed_rpm - speed))
        if abs(near.speed_rpm - speed) <= SAME * abs(speed):
            half = near.half_width_95_W
            p = Parameter(value=near.power_W, unit="WATT", determined=True, method="",
                          interval_95=(near.power_W - half, near.power_W + half))  # fmt: skip
            yield KnownValue(name=f"no-load power at {number(round(speed))}",
                             true=efficiency * power, parameter=p)  # fmt: skip
