"""Tables of the cut for its page: coefficients, how they were found, recordings, the spindle."""

from collections import Counter
from collections.abc import Mapping
from string import ascii_lowercase

from pipeline.charts.default_section import files_table
from pipeline.charts.numbers import (
    TOGETHER,
    between,
    number,
    resolved,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.schema.cutting import CutRecording, TermsTried
from pipeline.schema.model import Parameter
from pipeline.submodels.cutting.runs import (
    CuttingFacts,
)

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
}
"""What the parameters of the cut mean, for people."""
CHAIN = {"natural_frequency": "natural frequency of dynamometer and workpiece",
         "damping": "its damping ratio"}  # fmt: skip
SPINDLE_MEANINGS = {
    "p0": "no-load power of a spindle that hardly turns",
    "p1": "no-load power that grows with speed",
    "p2": "no-load power that grows with speed squared",
    "specific_force": "power at the tool for each volume of chips in time, edges and all",
    "K_tc": "of that what grows with the chip",
    "K_te": "of that what the edges take, for each width in the cut",
}
METHODS = {"least_squares": "least squares", "genetic": "genetic search"}
TERMS = {
    "runout": "runout",
    "helix": "helix angle",
    "modes": "ringing of the dynamometer’s channels",
    "teeth": "an edge of its own for each tooth",
}
"""Terms of the model, for people."""
USES = {"training": "learnt from", "judged": "judged", "left out": "left out"}
SHOP = {"N/mm^2": "N/mm²", "um": "µm", "deg": "°", "1": "", "WATT": "W", "W s^2": "W s²"}
"""Unit in a file -> unit as shown."""
UNDETERMINED = "not determined"
OPEN = 12
"""Rows of a table that need not be unfolded."""


def model_sources(facts: CuttingFacts) -> list[Source]:
    """The file that the coefficients stand in."""
    return _sources(facts, "model.json")


def verdict_sources(facts: CuttingFacts, *more: str) -> list[Source]:
    """The file that the judgement stands in."""
    return _sources(facts, *(more or ("verdict.json",)))


def _sources(facts: CuttingFacts, *files: str) -> list[Source]:
    shelf = facts.shown.shelf
    return [] if shelf is None else sources(shelf, *(facts.shown.folder / one for one in files))


# ---- parameters


def unit_of(p: Parameter) -> str:
    """The unit of a parameter as it is printed.

    >>> p = Parameter(value=1.0, unit="um", interval_95=None, determined=True, method="")
    >>> unit_of(p)
    'µm'
    """
    return SHOP.get(p.unit, p.unit).replace(" ", TOGETHER)


def value_words(p: Parameter) -> str:
    """The value with the digits that its interval resolves, or that it is not determined."""
    if not p.determined:
        return UNDETERMINED
    return number(p.value, resolved(*(p.interval_95 or (None, None))))


def interval_words(p: Parameter) -> str:
    """The interval; a dash where there is none."""
    return between(*p.interval_95) if p.determined and p.interval_95 else "–"


def shared_methods(parameters: Mapping[str, Parameter]) -> tuple[str, dict[str, str]]:
    """How parameters were found, as a note, and the mark in a row for each that several share.

    >>> p = Parameter(value=1.0, unit="1", interval_95=None, determined=True, method="motion")
    >>> shared_methods({"a": p, "b": p})
    ('Those with a number were found by motion.', {'motion': '–'})
    """
    counts = Counter(p.method for p in parameters.values() if p.determined)
    often = [one for one, count in counts.items() if one and (count > 1 or len(counts) == 1)]
    if len(counts) == 1 and often:
        return f"Those with a number were found by {often[0].rstrip('.')}.", {often[0]: "–"}
    marks = {one: f"({letter})" for one, letter in zip(often, ascii_lowercase, strict=False)}
    words = "; ".join(f"{mark} {one.rstrip('.')}" for one, mark in marks.items())
    return (f"How found: {words}." if words else ""), marks


def remark(p: Parameter | None, marks: Mapping[str, str], said: str = "") -> str:
    """Why a parameter is not determined and what to record, or how it was found."""
    if p is None:
        return "–"
    if p.determined:
        return said or marks.get(p.method, p.method) or "–"
    return (f"{p.method}: {p.remedy}" if p.remedy else p.method) or "–"


def coefficients_table(facts: CuttingFacts) -> Table | None:
    """Each parameter of the fit with its interval, beside that of the mean forces alone."""
    model = facts.model
    if model is None or not model.coefficients:
        return None
    parameters, means = model.coefficients, model.mean_force
    beside = any(p.determined for p in means.values())
    note, marks = shared_methods(parameters)
    pair = (("value", ""), ("95 % interval", ""))
    rows = []
    for name in [*parameters, *(name for name in means if name not in parameters)]:
        p, mean = parameters.get(name), means.get(name)
        both = (p, mean) if beside else (p,)
        shown = [
            words for one in both
            for words in (("–", "–") if one is None else (value_words(one), interval_words(one)))
        ]  # fmt: skip
        unit = next((unit_of(one) for one in (p, mean) if one is not None), "")
        rows.append(
            cells(
                Cell(text=name, code=True), MEANINGS.get(name, "–"), *shown, unit or "–",
                remark(p, marks, model.remarks.get(name, "")),
            )
        )  # fmt: skip
    return Table(
        caption="Coefficients of the cut",
        note=note,
        heads=[
            *names("Parameter", "means"),
            *numbers(*pair, group="Whole waveform" if beside else ""),
            *(numbers(*pair, group="Mean forces alone") if beside else []),
            *names("unit", "method, or why not"),
        ],
        rows=rows,
        sources=model_sources(facts),
    )


def small_table(
    facts: CuttingFacts, caption: str, parameters: Mapping[str, Parameter],
    meanings: Mapping[str, str], *, folded: bool = False,
) -> Table | None:  # fmt: skip
    """Parameters with value, interval, unit and how they were found; None without any.

    What a parameter means stands in ``meanings`` under the last word of its name.
    """
    if not parameters:
        return None
    note, marks = shared_methods(parameters)
    return Table(
        caption=caption,
        note=note,
        heads=[*names("Parameter", "means"), *numbers(("value", ""), ("95 % interval", "")),
               *names("unit", "method, or why not")],
        rows=[
            cells(Cell(text=name, code=True), meanings.get(name.split(" ")[-1], "–"),
                  value_words(p), interval_words(p), unit_of(p) or "–", remark(p, marks))
            for name, p in parameters.items()
        ],
        sources=model_sources(facts),
        folded=folded,
    )  # fmt: skip


def chain_table(facts: CuttingFacts) -> Table | None:
    """The measuring chain: where each channel of the dynamometer rings."""
    channels = {} if facts.model is None else facts.model.channels
    parameters = {
        f"{axis} {name.removesuffix('_Hz')}": p
        for axis, rows in channels.items() for name, p in rows.items()
    }  # fmt: skip
    caption = "Measuring chain: what the dynamometer adds to the forces"
    return small_table(facts, caption, parameters, CHAIN, folded=True)


def spindle_table(facts: CuttingFacts) -> Table | None:
    """No-load power and specific force with their intervals, or why they are not determined."""
    rows = {} if facts.model is None else facts.model.spindle_parameters
    return small_table(facts, "What the spindle’s load says of the cut", rows, SPINDLE_MEANINGS)


def training_files_table(facts: CuttingFacts) -> Table | None:
    """Files by hash that the coefficients were found from."""
    if facts.model is None:
        return None
    names_ = {one.recording for one in facts.model.recordings}
    trained = [one for one in facts.model.trained_on if one.case in names_]
    return files_table(trained, "the coefficients were", model_sources(facts))


# ---- how the model was chosen


def methods_table(facts: CuttingFacts) -> Table | None:
    """Least squares against the genetic search, on the same waveforms."""
    if facts.model is None or not facts.model.methods:
        return None
    return Table(
        caption="Least squares against genetic search, on the same revolutions",
        heads=[*names("Method"), *numbers(("RMS error", "%"), ("evaluations", "")),
               *names("kept")],
        rows=[
            cells(METHODS.get(row.method, row.method), number(row.rms_error_percent, 4),
                  number(row.evaluations), "kept" if row.method == facts.model.method else "–")
            for row in facts.model.methods
        ],
        sources=model_sources(facts),
        folded=True,
    )  # fmt: skip


def terms_table(facts: CuttingFacts) -> Table | None:
    """Terms that were tried, by how recordings left out are predicted with them."""
    model = facts.model
    if model is None or not model.terms:
        return None
    several = [one.role for one in model.recordings].count("training") != 1
    what = "error on recordings left out" if several else "information criterion"

    def cells_of(row: TermsTried) -> list[Cell]:
        terms = ", ".join(TERMS.get(one, one) for one in row.terms) or "none"
        value = number(100 * row.value if several else row.value, 4)
        return cells(terms, value, "kept" if row.kept else "–")

    return Table(
        caption=f"What the model may hold, by the {what}",
        note="Kept: the fewest unknowns among those whose error is close to the least.",
        heads=[*names("Terms beside the coefficients"),
               *numbers((what, "%" if several else "")), *names("kept")],
        rows=[cells_of(row) for row in model.terms],
        sources=model_sources(facts),
        folded=True,
    )  # fmt: skip


# ---- recordings

CONDITIONS = (
    (("speed", "rev/min"), "speed_rpm", 4),
    (("feed per tooth", "mm"), "feed_per_tooth_mm", 3),
    (("depth", "mm"), "axial_depth_mm", 3),
)
"""Conditions of a cut as a table shows them: head, field, digits."""


def condition_cells(row: CutRecording) -> list[str]:
    """Speed, feed per tooth and depth of a recording in words; dashes where they are not known."""
    values = [(getattr(row, name), digits) for _, name, digits in CONDITIONS]
    return ["–" if x is None else _plain(x, digits) for x, digits in values]


def _plain(value: float, digits: int) -> str:
    return number(int(value)) if value == int(value) else number(value, digits)


def recordings_table(facts: CuttingFacts) -> Table | None:
    """Conditions of every recording, what it was used for, and why not."""
    rows = () if facts.model is None else facts.model.recordings
    if not rows:
        return None
    roles = [row.role for row in rows]
    counts = ", ".join(f"{roles.count(role)} {use}" for role, use in USES.items() if role in roles)
    return Table(
        caption=f"Recordings of the cut: {counts}{left_out(len(rows), MOST_ROWS)}",
        heads=[*names("Recording", "use"), *numbers(*(head for head, *_ in CONDITIONS)),
               *numbers(("engagement", "°"), ("revolutions", "")),
               *names("what was done to it, or why not")],
        rows=[_recording_row(row) for row in rows[:MOST_ROWS]],
        sources=model_sources(facts),
        folded=len(rows) > OPEN,
    )  # fmt: skip


def _recording_row(row: CutRecording) -> list[Cell]:
    arc = "–"
    if row.entry_deg is not None and row.exit_deg is not None:
        arc = f"{number(round(row.entry_deg))} to {number(round(row.exit_deg))}"
    return cells(
        Cell(text=row.recording, code=True), USES.get(row.role, row.role), *condition_cells(row),
        arc, number(row.revolutions), row.reason or "; ".join(row.notes) or "–",
    )  # fmt: skip


# ---- spindle


def logs_table(facts: CuttingFacts) -> Table | None:
    """What of each log is not used, and why; None when all of them are used whole."""
    spindle = None if facts.model is None else facts.model.spindle
    if spindle is None or not (spindle.left_out or spindle.notes):
        return None
    used = spindle.recordings
    rows: list[tuple[str, str, str]] = []
    for name in used:
        of = [one.removeprefix(f"{name}: ") for one in spindle.notes if one.startswith(f"{name}: ")]
        rows.append((name, "used", "; ".join(of) or "–"))
    rows += [(lost.case, "left out", lost.reason.removeprefix(f"{lost.case} "))
             for lost in spindle.left_out]  # fmt: skip
    return Table(
        caption=f"Logs of the spindle’s load: {number(len(used))} used, "
        f"{number(len(spindle.left_out))} left out{left_out(len(rows), MOST_ROWS)}",
        heads=names("Log", "use", "what of it is not used, or why not"),
        rows=[cells(Cell(text=name, code=True), *rest) for name, *rest in rows[:MOST_ROWS]],
        sources=model_sources(facts),
        folded=len(rows) > OPEN,
    )
