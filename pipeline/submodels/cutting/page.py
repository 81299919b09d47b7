"""Cutting's part of a machine's page: verdict, key figures, sections, in the shop floor's words."""

from pipeline.charts.default_section import strongest_correlation
from pipeline.charts.numbers import NARROW, TOGETHER, counted, fixed, joined, number
from pipeline.charts.sections import (
    Block,
    Compared,
    Heading,
    Section,
    SubModelPage,
    present,
)
from pipeline.schema.cutting import CuttingModel, ResidualConditions
from pipeline.schema.model import Correlation, Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.cutting.figures import no_load_figures, revolutions
from pipeline.submodels.cutting.headline import (
    ERROR_WORDS,
    beyond_words,
    cutting_verdict,
    key_figures,
    plain_better_words,
    recordings_words,
    undetermined_words,
)
from pipeline.submodels.cutting.judged_tables import (
    PLAIN_WHAT,
    components_table,
    cross_table,
    load_table,
    runs_table,
    truth_table,
)
from pipeline.submodels.cutting.runs import (
    ALIKE,
    ERRORS,
    CuttingFacts,
    cutting_facts,
    worst_run,
)
from pipeline.submodels.cutting.tables import (
    METHODS,
    chain_table,
    coefficients_table,
    logs_table,
    methods_table,
    recordings_table,
    spindle_table,
    terms_table,
    training_files_table,
    unit_of,
    value_words,
)

ILL = 1e4
"""Condition number of the scaled Jacobian above which coefficients are hard to separate [1]."""
CLOSE = 0.95
"""Correlation above which two coefficients are known as a sum only [1]."""
UNCONVERGED = 1.5
"""Error of a search over the other's beyond which it has not found the optimum [1]."""
MOST_FEEDS = 4
"""Feeds of a set of conditions that are named."""
LAW = (
    "The force on a cutting edge is taken as a cutting coefficient times the area of the chip "
    "plus an edge coefficient times its width, along the cutting speed (t), away from the "
    "workpiece (r) and along the axis (a)."
)
NO_FORCES = (
    "No force was recorded on a dynamometer, so no coefficient of a direction is known: a slot at "
    "three feeds or more, at 10 kHz, gives all of them."
)
LOAD_SERVES = (
    "When there is no dynamometer, the load of the spindle serves: logged over MTConnect with the "
    "line of a program of known cuts, and once without a cut, it gives the specific force, though "
    "no coefficient of a direction."
)
WEAR = (
    "The edge coefficients are the part of the force that does not depend on the chip, that is "
    "rubbing. Edge coefficients that grow with the same tool, material and depth mean a wearing "
    "edge: measure its flank and change it. Runout that grows means dirt, a worn collet or a bent "
    "shank: clean the taper, clamp the tool anew, check it with a dial gauge. Runout also loads "
    "one tooth more than its neighbours, and that one wears first."
)
ONCE = (
    "One set of records cannot say whether either has grown, nor tell a worn edge from a harder "
    "batch of material: cut the same slots again, once with a new edge and then every few weeks, "
    "and the list of changes below says what moved."
)
JUDGED = "Only recordings that were not used in the fit are judged."
CROSS = (
    "Every recording was learnt from, so each is also predicted by a fit on the others: a weaker "
    "proof than a recording of another day or another clamping would be."
)
WORN = ("K_te", "K_re", "K_ae", "spindle specific_force", "spindle K_te")
"""Parameters that grow as an edge wears, by group and name."""
REMEDIES = {
    **dict.fromkeys(WORN, "an edge that has worn since, or a harder batch of material: measure "
                          "the flank, and change the edge"),
    "runout": "a tool that no longer runs true: clean the taper, clamp it anew, check it with a "
              "dial gauge",
}  # fmt: skip
"""What growth beyond both intervals means, by parameter."""


def cutting_page(shown: Shown[CuttingModel]) -> SubModelPage:
    """Everything that only cutting can show and say."""
    facts = cutting_facts(shown)
    worst, peak = worst_run(facts.telling), worst_run(facts.telling, "peak")
    truth = truth_table(facts) if shown.origin == "simulated" else None
    return SubModelPage(
        verdict=cutting_verdict(facts),
        key_figures=key_figures(facts),
        doubts=[words] if (words := plain_better_words(facts)) else [],
        notes=[
            *([undetermined_words(facts)] if facts.undetermined else []),
            *([words] if (words := beyond_words(facts)) else []),
        ],
        sections=[s for s in (cut_section(facts), prediction_section(facts)) if s is not None],
        truth=[] if truth is None else [truth],
        changed=wear_note,
        compared={} if shown.model is None and shown.verdict is None else {
            "cut_rms_percent": Compared(
                name="Error of cutting forces (RMS), worst recording", unit="%",
                value=worst.size("rms") if worst else None,
            ),
            "cut_peak_percent": Compared(
                name="Error of peak cutting forces, worst recording", unit="%",
                value=peak.size("peak") if peak else None,
            ),
            "cuts_judged": Compared(
                name="Cuts judged", unit="", value=len(facts.judged) if shown.verdict else None
            ),
        },
    )  # fmt: skip


def wear_note(group: str, name: str, before: Parameter, now: Parameter) -> str:
    """What to do about a parameter that grew beyond both intervals; else empty.

    >>> def p(low, high):
    ...     return Parameter(value=low, unit="um", interval_95=(low, high), determined=True,
    ...                      method="")
    >>> wear_note("", "runout", p(8.0, 12.0), p(15.0, 16.0))[:49]
    'runout grew by more than both intervals allow: lo'
    >>> wear_note("", "runout", p(15.0, 16.0), p(8.0, 12.0))
    ''
    """
    full = f"{group} {name}".strip()
    remedy = REMEDIES.get(full, "")
    if not remedy or before.interval_95 is None or now.interval_95 is None:
        return ""
    if now.interval_95[0] <= before.interval_95[1]:
        return ""
    return (
        f"{full} grew by more than both intervals allow: look for {remedy}. "
        "That holds if tool, material and clamping are the same as then."
    )


# ---- the cut


def cut_section(facts: CuttingFacts) -> Section | None:
    """Coefficients and what they were found from, then the spindle's own load."""
    model = facts.model
    if model is None:
        return None
    identified = facts.has_coefficients
    text = [
        LAW if identified else _no_forces(model),
        f"{_found_from(model)} {_fit_words(model)}".strip() if identified else "",
        _runout_words(model),
        residual_words(model),
    ]
    if facts.verdict is None and identified:
        text.append("No recording has been held against the forces yet: there is no verdict.json.")
    blocks: list[Block] = present(coefficients_table(facts), chain_table(facts))
    if identified:
        blocks.append(Heading(heading="What maintenance can read from this",
                              text=f"{WEAR} {ONCE}"))  # fmt: skip
    methods = methods_table(facts)
    if methods is not None:
        blocks += [Heading(heading="How they were identified", text=methods_words(model)), methods]
    blocks += present(terms_table(facts), recordings_table(facts), training_files_table(facts))
    spindle = present(
        spindle_table(facts), load_table(facts), no_load_figures(facts), logs_table(facts)
    )
    words = spindle_words(model)
    if spindle or words:
        blocks += [Heading(heading="Power of the spindle", text=words), *spindle]
    return Section(key="cutting", title="The cut: forces at the tool",
                   text=[words for words in text if words], blocks=blocks)  # fmt: skip


def _no_forces(model: CuttingModel) -> str:
    """Why there are no coefficients, and what serves where nothing better can be recorded."""
    reason = model.reason.rstrip(".")
    words = f"No coefficient of the cut could be found: {reason}." if reason else NO_FORCES
    return words if model.spindle is not None else f"{words} {LOAD_SERVES}"


def _found_from(model: CuttingModel) -> str:
    count = sum(row.role == "training" for row in model.recordings)
    of = _cut_words(model)
    if not count:
        return f"The recordings that they were identified from{of} are not named."
    return f"Identified from {counted(count, 'recording')}{of}."


def _cut_words(model: CuttingModel) -> str:
    """Which tool cut which material."""
    tool = model.tool
    kind = str(tool.get("kind") or "").replace("_", " ")
    words = f" of a {kind} cutter" if kind else " of a tool"
    diameter, flutes = tool.get("diameter_mm"), tool.get("flutes")
    size = [f"{diameter:g}{NARROW}mm" if diameter else "", f"{flutes:g} teeth" if flutes else ""]
    named = [one for one in size if one]
    if named:
        words += f" ({', '.join(named)})"
    return f"{words} in {model.material}" if model.material else words


def _fit_words(model: CuttingModel) -> str:
    """How well the fit holds, and which two coefficients are the most correlated."""
    fit, words = model.fit, []
    if fit is not None:
        over = [counted(n, one) for n, one in ((fit.samples, "sample"),
                                               (fit.revolutions, "revolution")) if n]  # fmt: skip
        words.append(f"The residual of the fit is {number(fit.rms_error_percent, 2)} % of the RMS "
                     "force" + (f" over {' of '.join(over)}" if over else ""))  # fmt: skip
        ill = ", so some are hard to separate" if fit.condition > ILL else ""
        words.append(f"the condition is {number(fit.condition, 2)}{ill}")
    taken = model.prediction
    if taken is not None and taken.line:
        words.append("forces are predicted by a law whose edge force grows over "
                     f"{number(1e6 * taken.growth_m, 2)} um of chip, with a size effect of "
                     f"exponent {number(taken.exponent, 2)}")  # fmt: skip
    pair = strongest_correlation(_shown_correlation(model))
    if pair is not None:
        close = ", so that little more than their sum is known" if abs(pair[2]) > CLOSE else ""
        words.append(f"the most correlated are {pair[0]} and {pair[1]} (correlation "
                     f"{fixed(pair[2], 2)}{close})")  # fmt: skip
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _shown_correlation(model: CuttingModel) -> Correlation:
    """Correlation of those unknowns that the table shows; the fit has others besides."""
    names, values = model.correlation.names, model.correlation.values
    kept = [k for k, name in enumerate(names) if name in model.coefficients]
    return Correlation(
        names=tuple(names[k] for k in kept),
        values=tuple(tuple(values[i][j] for j in kept) for i in kept),
    )


def _runout_words(model: CuttingModel) -> str:
    """What the runout was when the records were made; empty where it is not determined."""
    runout = model.coefficients.get("runout")
    if runout is None or not runout.determined:
        return ""
    off = f"{value_words(runout)}{NARROW}{unit_of(runout)}".strip()
    return f"In these records the tool’s axis was {off} off the spindle’s."


def residual_words(model: CuttingModel) -> str:
    """What is learnt beside mechanics, and for which conditions; empty where nothing is."""
    rows = model.residual_conditions
    if not rows:
        return ""
    holds = "; ".join(_conditions(row) for row in rows[:3])
    more = f" and {counted(len(rows) - 3, 'more set')} of conditions" if len(rows) > 3 else ""
    return (
        "Beside mechanics the model holds what mechanics leave over, by the angle of the spindle; "
        "affine in the feed. That part was learnt, not understood, and is used only where it was "
        f"learnt: {holds}{more}. Under any other conditions mechanics alone predict."
    )


def _conditions(row: ResidualConditions) -> str:
    feeds = sorted(set(row.feeds_per_tooth_mm))
    words = joined([f"{feed:g}" for feed in feeds])
    if len(feeds) > MOST_FEEDS:
        words = f"{len(feeds)} feeds from {feeds[0]:g} to {feeds[-1]:g}"
    low, high = row.holds_for_mm
    return ", ".join(
        [
            f"{number(round(row.speed_rpm))}{TOGETHER}rev/min",
            f"{row.axial_depth_mm:g}{TOGETHER}mm deep",
            f"learnt at {words}{TOGETHER}mm per tooth",
            f"used from {low:g} to {high:g}",
        ]
    )


def methods_words(model: CuttingModel) -> str:
    """Which search came closer and what it cost, in one sentence; empty without two."""
    by_name = {row.method: row for row in model.methods}
    if not all(name in by_name for name in METHODS):
        return ""
    squares, genetic = (by_name[name] for name in METHODS)
    errors = [squares.rms_error_percent, genetic.rms_error_percent]
    if errors[1] > UNCONVERGED * errors[0]:
        after = (
            f" after {counted(genetic.evaluations, 'evaluation')}" if genetic.evaluations else ""
        )
        return (
            f"Least squares errs by {number(errors[0], 3)} % of the RMS force; the genetic search "
            f"had not converged{after} ({number(errors[1], 3)} %)."
        )
    if abs(errors[0] - errors[1]) <= ALIKE * max(errors):
        text = f"Least squares and the genetic search are alike within {100 * ALIKE:g} %"
    else:
        first = "Least squares" if errors[0] < errors[1] else "The genetic search"
        text = (
            f"{first} comes closer: {number(min(errors), 3)} against {number(max(errors), 3)} % "
            "of the RMS force"
        )
    if not squares.evaluations or not genetic.evaluations:
        return text + "."
    return (
        f"{text}; for each evaluation of least squares the genetic search needed "
        f"{number(genetic.evaluations / squares.evaluations, 2)}."
    )


def spindle_words(model: CuttingModel) -> str:
    """What was found from the spindle's load, and what it is good for."""
    spindle = model.spindle
    if spindle is None:
        return ""
    in_table = {lost.reason for lost in spindle.left_out}
    reason = "; ".join(one for one in spindle.reason.split("; ") if one not in in_table)
    ends = [words.rstrip(".") for words in (spindle.assumed, reason)]
    rest = "".join(f" {words[0].upper()}{words[1:]}." for words in ends if words)
    words = "From the load that the control shows"
    if spindle.recordings:
        used = spindle.recordings
        many = f" and {len(used) - 2} more" if len(used) > 2 else ""
        words += f" ({', '.join(used[:2])}{many})"
    specific = model.spindle_parameters.get("specific_force")
    if specific is None or not specific.determined:
        return f"{words} no specific force could be had.{rest}"
    # N/mm^2 as power for a rate of chips [W min/cm^3]
    watts = number((specific.value or 0.0) / 60)
    return (
        f"{words} each cm³ of chips a minute takes {watts}{NARROW}W at the tool: no "
        "dynamometer is needed to watch this one number, and it grows as the edge wears, with thin "
        f"chips most.{rest}"
    )


# ---- predicted forces


def prediction_section(facts: CuttingFacts) -> Section | None:
    """Every recording against the model, then the worst and the best predicted revolution."""
    if facts.verdict is None:
        return None
    verdict = cutting_verdict(facts)
    text = [
        verdict.sentence if verdict is not None else "",
        f"{JUDGED if facts.judged or not facts.cross else CROSS} The model is given speed, "
        "feed, depth and the tool alone, and what it predicts is laid over the mean revolution "
        "that was measured.",
        _plain_words(facts),
    ]
    if not facts.runs and not facts.cross:
        text.append("No recording was held against the model.")
    return Section(
        key="forces",
        title="How well forces are predicted",
        text=[words for words in text if words],
        blocks=present(runs_table(facts), cross_table(facts), revolutions(facts),
                       components_table(facts)),
    )  # fmt: skip


def _plain_words(facts: CuttingFacts) -> str:
    """In what the plain guess is closer than the model, or that it is nowhere."""
    compared = [run for run in facts.telling if run.size("rms", "plain") is not None]
    if not compared:
        return ""
    better = {kind: sum(run.plain_better(kind) for run in compared) for kind in ERRORS}
    closer = [f"in the {ERROR_WORDS[kind]} on {many}" for kind, many in better.items() if many]
    where = f"closer than the model {joined(closer)}" if closer else "nowhere closer than the model"
    return f"Held against {recordings_words(facts)}, the plain guess ({PLAIN_WHAT}) is {where}."
