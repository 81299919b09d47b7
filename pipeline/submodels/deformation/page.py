"""Page of spindle growth: the first hour, faulty sensors, all methods, what the model is off by."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.charts import default_section
from pipeline.charts.numbers import NARROW, TOGETHER, counted, fixed, joined, number, signed
from pipeline.charts.sections import (
    Block,
    Compared,
    Figure,
    Figures,
    PartVerdict,
    Section,
    SubModelPage,
    absent,
    present,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, sources, tabulated
from pipeline.nets.settings import FuzzyFilteredSettings
from pipeline.schema.verdict import Score
from pipeline.signals.store import parquet_name
from pipeline.submodels.deformation import figures
from pipeline.submodels.deformation.growth_facts import (
    GOAL_MAPE,
    GOAL_MAX_UM,
    GrowthFacts,
    Seen,
    SensorFault,
    condition,
)
from pipeline.submodels.deformation.model import (
    COOLING,
    REGIMES,
    WARMING,
    MethodScore,
    MethodsFile,
)
from pipeline.submodels.deformation.records import AMBIENT, SPEED

FOLLOWED = "growth, interval follows the probe"
"""Name of the same prediction with the interval that follows the probe."""
CELSIUS = "°C"
DEAD = "dead"


def page(shown: Seen) -> SubModelPage:
    """Everything that a machine's page says of its spindle's growth."""
    facts = GrowthFacts(shown=shown)
    return SubModelPage(
        verdict=_verdict(facts),
        key_figures=_key_figures(facts),
        notes=_notes(facts),
        sections=[_expected(facts), *present_sections(_compared_section(facts), _errors(facts))],
        compared={
            "growth_rmse_um": _compared("Growth of the spindle, RMSE", facts.total, "rmse"),
            "growth_max_um": _compared("Growth of the spindle, largest error", facts.total, "max"),
        },
    )


def present_sections(*sections: Section | None) -> list[Section]:
    """Those sections that there are."""
    return [one for one in sections if one is not None]


def _compared(name: str, score: Score | None, error: str) -> Compared:
    return Compared(name=name, unit="um", value=None if score is None else getattr(score, error))


def _um(value: float | None, decimals: int = 1) -> str:
    return "not known" if value is None else f"{fixed(value, decimals)}{TOGETHER}µm"


def _whole_um(value: float) -> str:
    return f"{fixed(value, 0)}{TOGETHER}µm"


def short(case: str) -> str:
    """Name of a recording as a person says it: its file without folder and ending.

    >>> short("growth/profile-18-warm-up.csv")
    'profile-18-warm-up'
    """
    return case.rpartition("/")[2].rpartition(".")[0] or case


# ---- in words


def _speed_words(speed: float | None) -> str:
    return "" if speed is None else f"{number(round(speed))}{NARROW}rev/min"


def _hour_words(facts: GrowthFacts) -> str:
    """Growth of the first hour, with its interval; empty where nothing is predicted."""
    hour = facts.first_hour
    if hour is None:
        return ""
    at = f" at up to {_speed_words(hour.speed)}" if hour.speed is not None else ""
    return (
        f"In its first hour{at} the spindle grows by up to {_whole_um(hour.growth)} (90 % "
        f"interval {fixed(hour.low, 0)} to {_whole_um(hour.high)})"
    )


def _warm_words(facts: GrowthFacts) -> str:
    """How long to warm up."""
    hour = facts.first_hour
    if hour is None:
        return ""
    at = f" at {_speed_words(hour.speed)}" if hour.speed is not None else ""
    return (
        f"warm up for {fixed(np.ceil(hour.settled_min), 0)}{TOGETHER}min{at} before finishing "
        f"cuts (the rest of the hour then moves less than {_whole_um(hour.within_um)})"
    )


def sensor_words(fault: SensorFault) -> str:
    """What is wrong with a sensor and since when, without a full stop."""
    off = "" if fault.worst_K is None else f", off by up to {fixed(fault.worst_K, 1)}{TOGETHER}K"
    until = "" if fault.lasts else f", in {counted(fault.cases, 'recording')}"
    return (
        f"{fault.sensor} is {fault.kind} since {short(fault.case)}, minute "
        f"{fixed(fault.minute, 0)}{off}{until}"
    )


def _mend(faults: Sequence[SensorFault]) -> str:
    """What to do about faulty sensors; empty without any that lasts."""
    lasting = [one for one in faults if one.lasts]
    if not lasting:
        return ""
    words = [
        f"{'reconnect or replace' if one.kind == DEAD else 'replace'} {one.sensor}"
        for one in lasting
    ]
    said = joined(words)
    return f"{said[:1].upper()}{said[1:]}"


def _cost_words(facts: GrowthFacts) -> str:
    """What the faulty sensors cost as they are, and with the others in their place."""
    if facts.cost is None:
        return ""
    as_is, replaced = facts.cost
    return (
        f"Read as they are they would put the predicted growth off by up to {_whole_um(as_is)}; "
        f"the model does without them and is off by up to {_um(replaced)}."
    )


def _verdict(facts: GrowthFacts) -> PartVerdict | None:
    """What growth is to be expected and what to do; the status of the judgement."""
    shown, verdict = facts.shown, facts.shown.verdict
    if shown.model is None and verdict is None:
        return None
    hour, mend = _hour_words(facts), _mend(facts.faults)
    first = f"{mend}. " if mend else ""
    if verdict is None or verdict.status == "not judged":
        why = "; ".join(verdict.reasons) if verdict is not None and verdict.reasons else (
            "no recording was kept out of its fit"
        )  # fmt: skip
        return PartVerdict(
            status="unknown",
            sentence=f"{hour}{'; but the' if hour else 'The'} model of the spindle’s growth has "
            f"not been judged: {why.rstrip('.')}.",
            todo=f"{first}Record further speed profiles that the model is not fitted on.",
        )
    warm = _warm_words(facts)
    if verdict.status == "failed":
        return PartVerdict(
            status="failed",
            sentence=f"{hour}{'; but the' if hour else 'The'} model of that growth failed on "
            f"{_judged_on(facts)}: {_failure(facts)}.",
            todo=f"{first}Load no correction from this model; "
            f"{warm or 'measure the growth before finishing cuts'}.",
        )
    command = f"kerf compensation --machine {shown.machine} --out FILE"
    loads = f"load the correction (`{command}`), which leaves up to {_um(_largest(facts))}"
    either = f"{warm[:1].upper()}{warm[1:]}, or " if warm else ""
    return PartVerdict(
        status="passed",
        sentence=f"{hour}{'; the' if hour else 'The'} model of that growth passed on "
        f"{_judged_on(facts)}: it is off by {_um(_largest(facts))} at most"
        f"{_limit_words(facts)}.",
        todo=f"{first}{either}{loads if either else loads[:1].upper() + loads[1:]}.",
    )  # fmt: skip


def _failure(facts: GrowthFacts) -> str:
    """By how much and where it missed its limit; else the judge's gravest reason."""
    worst = max(facts.ranked(), key=lambda s: s.max or 0.0, default=None)
    if worst is not None and facts.limit is not None and (worst.max or 0.0) > facts.limit:
        return f"it is off by up to {_um(worst.max)} in {short(worst.group)}{_limit_words(facts)}"
    reasons = () if facts.shown.verdict is None else facts.shown.verdict.reasons
    return reasons[0] if reasons else "the judge gave no reason"


def _judged_on(facts: GrowthFacts) -> str:
    many = counted(len(facts.ranked()), "recording")
    return f"{many} {'of its golden set' if facts.role == 'golden' else 'held out of its fit'}"


def _limit_words(facts: GrowthFacts) -> str:
    return "" if facts.limit is None else f" (limit {_um(facts.limit)})"


def _largest(facts: GrowthFacts) -> float | None:
    return None if facts.total is None else facts.total.max


def _key_figures(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    found = []
    if (hour := facts.first_hour) is not None:
        aside = f"90 %: {fixed(hour.low, 0)} to {_whole_um(hour.high)}"
        if hour.speed is not None:
            aside += f", at up to {_speed_words(hour.speed)}"
        found.append(("Growth in the first hour", _whole_um(hour.growth), aside))
    if facts.total is not None:
        found.append(("Largest error of growth", _um(_largest(facts)),
                      f"recordings held out{_limit_words(facts)}"))  # fmt: skip
    if facts.faults:
        lasting = ", ".join(one.sensor for one in facts.faults)
        found.append(("Faulty temperature sensors", str(len(facts.faults)), lasting))
    return found


def _notes(facts: GrowthFacts) -> list[str]:
    said = []
    if facts.faults:
        said.append(f"Temperature sensors: {'; '.join(map(sensor_words, facts.faults))}. "
                    f"{_cost_words(facts)}".rstrip())  # fmt: skip
    return said


# ---- what to expect


def _made(facts: GrowthFacts, *files: str) -> list[Source]:
    return sources(facts.shown.shelf, *(facts.shown.folder / file for file in files))


def _expected(facts: GrowthFacts) -> Section:
    """Growth that is to be expected: the first hour, faulty sensors, a typical and a worst case."""
    key, title = "growth", "Spindle growth: what to expect"
    shown = facts.shown
    if shown.model is None:
        needs = (
            "It is identified from three temperatures or more along the spindle and a displacement "
            "probe at its nose, once a minute over ten speed profiles or more."
        )
        return Section(key=key, title=title, text=[absent(shown.folder / "model.json", needs)])
    text = [
        "A spindle lengthens as it warms, and the tool goes with it towards the workpiece. The "
        "model tells the growth since the start from the temperatures along the spindle, its speed "
        "and the air, so that the control can take it off.",
    ]
    if (hour := facts.first_hour) is not None:
        text.append(
            f"{_hour_words(facts)}: the largest of {counted(hour.others, 'recording')} that last "
            f"an hour, {short(hour.case)}, where the probe read {_whole_um(hour.measured)} at that "
            f"time. From minute {fixed(hour.settled_min, 0)} the rest of that hour moves less than "
            f"{_whole_um(hour.within_um)}."
        )
    if shown.verdict is not None and shown.verdict.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(shown.verdict.reasons) + ".")
    if shown.predictions is None:
        path = shown.folder / "predictions.parquet"
        text.append(absent(path, "Without it no recording can be drawn."))
    return Section(
        key=key, title=title, text=text,
        blocks=present(_sensors_table(facts), _recordings(facts)),
    )  # fmt: skip


def _sensors_table(facts: GrowthFacts) -> Table | None:
    """Faulty sensors, since when, how far off, what to do."""
    columns: list[Column[SensorFault]] = [
        Column("Sensor", lambda one: one.sensor),
        Column("is", lambda one: Cell(text=one.kind, status="failed")),
        Column("since recording", lambda one: short(one.case)),
        Column("at minute", lambda one: fixed(one.minute, 0), unit=""),
        Column("off by up to", lambda one: "–" if one.worst_K is None else fixed(one.worst_K, 1),
               unit="K"),
        Column("recordings", lambda one: number(one.cases), unit=""),
        Column("what to do", _sensor_todo),
    ]  # fmt: skip
    return tabulated("Faulty temperature sensors", facts.faults, columns,
                     _made(facts, "verdict.json"), note=_cost_words(facts))  # fmt: skip


def _sensor_todo(one: SensorFault) -> str:
    if not one.lasts:
        return "nothing: the last recording is sound"
    return "check cable and plug, else replace" if one.kind == DEAD else "replace"


def _recordings(facts: GrowthFacts) -> Figures | None:
    """A typical and the worst recording."""
    ranked = facts.ranked()
    if facts.shown.predictions is None or not ranked:
        return None
    worst = max(ranked, key=lambda s: s.max or 0.0)
    others = [one for one in ranked if one is not worst]
    chosen = [(one, "Typical recording") for one in others[len(others) // 2 :][:1]]
    chosen.append((worst, "Recording with the largest error"))
    drawn, with_sensors = [], False
    for score, words in chosen:
        one = _recorded(facts, score.group)
        with_sensors |= bool(one.temperatures)
        speed = condition(facts.shown.verdict, score.group, "highest speed")
        at = "" if speed is None else f", up to {_speed_words(speed)}"
        caption = (
            f"{words}, {short(score.group)}{at}: RMSE {_um(score.rmse, 2)}, largest error "
            f"{_um(score.max)}."
        )
        drawn.append(Figure(
            svg=figures.recording_figure(one, facts.limit, caption), caption=caption,
            sources=[*_made(facts, "predictions.parquet"), *_trace_source(facts, score.group)],
        ))  # fmt: skip
    legend = [("l-measured", "growth measured", "line"), ("l-window", "growth modelled", "line"),
              ("s-band", "its 90 % interval", "box")]  # fmt: skip
    if facts.limit is not None:
        legend.append(("l-limit", f"limit of the largest error, ±{_um(facts.limit)}", "dots"))
    if with_sensors:
        legend += [
            (f"l-{css}", f"sensors, {name}", "line")
            for css, name in zip(figures.GROUP_CURVES, figures.GROUP_NAMES, strict=True)
        ]
        legend += [("l-speed", "air, spindle speed", "line")]
        if facts.faults:
            legend.append(("l-batch", "faulty sensor", "dots"))
    return Figures(figures=drawn, legend=legend)


def _recorded(facts: GrowthFacts, group: str) -> figures.Recorded:
    rows = facts.whole[facts.whole["group"] == group].sort_values("t")
    time, measured, predicted, low, high = (
        rows[name].to_numpy(float) for name in ("t", "measured", "predicted", "low", "high")
    )
    clock, temperatures, speed = _traces(facts, group)
    return figures.Recorded(
        time=time, measured=measured, predicted=predicted, low=low, high=high,
        temperatures=temperatures, speed=speed, clock=clock,
    )  # fmt: skip


def _traces(
    facts: GrowthFacts, group: str
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray | None]:
    """Clock [s], temperatures [degC] by CSS class and name, speed [rev/min] of a recording.

    Empty where the signals are not there, or their columns are named otherwise than the sensors.
    """
    shown = facts.shown
    if shown.signals is None or shown.model is None:
        return np.zeros(0), {}, None
    names = shown.model.sensors.sensors
    table = shown.shelf.table(
        _trace(facts, group), ("t", *names, AMBIENT, SPEED), "raw files, by reading", all_of=False
    )
    if table is None or "t" not in table.column_names:
        return np.zeros(0), {}, None
    columns = {name: table.column(name).to_numpy().astype(float) for name in table.column_names}
    clock = columns["t"] - columns["t"][0]
    weights = np.array(shown.model.inputs.weights)
    faulty = {one.sensor for one in facts.faults if one.case <= group}
    found: dict[str, np.ndarray] = {}
    for k, name in enumerate(names):
        css = "batch" if name in faulty else figures.GROUP_CURVES[int(weights[:, k].argmax())]
        if name in columns:
            found[f"{css} {name}"] = columns[name]
    if found and AMBIENT in columns:
        found[f"speed {AMBIENT}"] = columns[AMBIENT]
    return clock, found, columns.get(SPEED)


def _trace(facts: GrowthFacts, group: str) -> Path:
    return (facts.shown.signals or Path()) / "traces" / parquet_name(group)


def _trace_source(facts: GrowthFacts, group: str) -> list[Source]:
    return [] if facts.shown.signals is None else sources(facts.shown.shelf, _trace(facts, group))


# ---- which method


def _compared_section(facts: GrowthFacts) -> Section | None:
    """All methods beside each other, and who wins."""
    model = facts.shown.model
    if model is None:
        return None
    return Section(
        key="growth-methods",
        title="Spindle growth: methods compared",
        text=[winner_words(facts), _goal_words(facts)],
        blocks=present(_methods_table(facts), _network(facts)),
    )


def winner_words(facts: GrowthFacts) -> str:
    """Which method serves, which is best, and where the fuzzy-filtered network stands."""
    model = facts.shown.model
    if model is None:
        return ""
    table = facts.methods or dict(model.compared)
    ranked = sorted(table, key=lambda name: table[name].rmse_um)
    own, best = table[model.champion], table[ranked[0]]
    where = _judged_on(facts) if facts.methods else "training recordings left out in turn"
    said = (
        f"“{own.label}” serves: of {counted(len(model.compared), 'method')} it errs least on "
        "training recordings left out in turn. "
    )
    if ranked[0] == model.champion:
        said += f"On {where} it wins again, with an RMSE of {_um(own.rmse_um, 2)}. "
    else:
        said += (
            f"On {where} “{best.label}” does better: RMSE {_um(best.rmse_um, 2)} against "
            f"{_um(own.rmse_um, 2)}. "
        )
    networks = [n for n in ranked if n.startswith("ffnn") and n != "ffnn_classic"]
    if networks and networks[0] != ranked[0]:
        place = ranked.index(networks[0]) + 1
        said += (
            f"The best improved fuzzy-filtered network, “{table[networks[0]].label}”, comes "
            f"{place}{_ordinal(place)} with {_um(table[networks[0]].rmse_um, 2)}: on these "
            "recordings it does not win."
        )
    elif networks:
        said += "It is the improved fuzzy-filtered network."
    return said.strip()


def _ordinal(place: int) -> str:
    return {1: "st", 2: "nd", 3: "rd"}.get(place if place < 20 else place % 10, "th")


def _goal_words(facts: GrowthFacts) -> str:
    """Goals of the paper beside what the method that serves reaches."""
    model = facts.shown.model
    own = None if model is None else facts.methods.get(model.champion)
    goals = (
        f"Goals (FFNN2015): largest error below {_um(GOAL_MAX_UM)} and relative error (MAPE, "
        f"growth below 5 µm counting as 5 µm) below {fixed(GOAL_MAPE, 1)} %."
    )
    if own is None:
        return goals
    largest = "met" if own.max_um < GOAL_MAX_UM else "missed"
    relative = "met" if own.mape_percent < GOAL_MAPE else "missed"
    return (
        f"{goals} The method that serves: largest error {_um(own.max_um)}, {largest}; relative "
        f"error {fixed(own.mape_percent, 1)} %, {relative}. The published figures rest on a test "
        "run that may be the training run."
    )


def _methods_table(facts: GrowthFacts) -> Table | None:
    """Errors of all methods on the recordings that decide."""
    model = facts.shown.model
    if model is None:
        return None
    judged = facts.methods
    things = list((judged or dict(model.compared)).items())
    if not judged:
        things.sort(key=lambda one: one[1].rmse_um)
    where = "Held out" if judged else "Left out"
    columns: list[Column[tuple[str, MethodScore]]] = [
        Column("Method", lambda one: one[1].label + (" (serves)" if one[0] == model.champion
                                                     else "")),
        Column("RMSE", lambda one: fixed(one[1].rmse_um, 2), unit="µm", group=where),
        Column("largest error", lambda one: _goal(one[1].max_um, GOAL_MAX_UM), unit="µm",
               group=where),
        Column("R", lambda one: "–" if one[1].r is None else fixed(one[1].r, 4), unit="",
               group=where),
        Column("MAPE", lambda one: _goal(one[1].mape_percent, GOAL_MAPE), unit="%", group=where),
        Column("RMSE of single seeds", lambda one: _seeds(one[1]), unit="µm", group=where),
    ]  # fmt: skip
    if judged:
        columns.append(Column(
            "RMSE", lambda one: fixed(model.compared[one[0]].rmse_um, 2), unit="µm",
            group="Left out",
        ))  # fmt: skip
    return tabulated(
        "All methods on whole recordings that their fit did not see", things, columns,
        _made(facts, "model.json", "predictions.parquet"),
        note="Held out: recordings that decide. Left out: training recordings, each predicted by "
        "a fit of others. Green where the goal is met. A method that depends on chance is the mean "
        "of its seeds; the last but one column is the range of single ones." if judged else "",
    )  # fmt: skip


def _goal(value: float, goal: float) -> Cell:
    """A value that is ticked where it meets its goal."""
    return Cell(text=fixed(value, 1), status="passed" if value < goal else "")


def _seeds(one: MethodScore) -> str:
    low, high = one.seed_rmse_um
    return "–" if one.seeds == 1 else f"{fixed(low, 2)} to {fixed(high, 2)}"


def _network(facts: GrowthFacts) -> Figures | None:
    """Bands of the best improved network over the sensors, and the groups of sensors."""
    shown = facts.shown
    if shown.model is None:
        return None
    path = shown.folder / "methods.json"
    stored = shown.shelf.read(path, MethodsFile, "the training recordings")
    weights = np.array(shown.model.inputs.weights)
    table = facts.methods or dict(shown.model.compared)
    improved = [] if stored is None else [
        name for name in sorted(table, key=lambda n: table[n].rmse_um)
        if (docs := stored.documents.get(name, ()))
        and docs[0].get("kind") == FuzzyFilteredSettings.kind
    ]  # fmt: skip
    bands = None
    words = "Weight of each sensor in the temperatures of front, middle and rear (fuzzy c-means)"
    if stored is not None and improved:
        bands = figures.network_bands(stored.documents[improved[0]][0], weights.shape[1])
        centres = joined([fixed(c + 1, 1) for c, _ in bands])
        words = (
            f"Above: bands of “{table[improved[0]].label}” (first seed) over the sensors, centred "
            f"at sensor {centres}. Below: weight of each sensor in the temperatures of front, "
            "middle and rear (fuzzy c-means)"
        )
    names = "; ".join(f"{k + 1} {name}" for k, name in enumerate(shown.model.sensors.sensors))
    caption = f"{words}. Sensors: {names}."
    figure = Figure(svg=figures.network_figure(bands, weights, caption), caption=caption,
                    sources=_made(facts, "model.json", "methods.json"))  # fmt: skip
    legend = [
        (f"s-{css}", name, "box")
        for css, name in zip(figures.GROUP_CURVES, figures.GROUP_NAMES, strict=True)
    ]
    return Figures(figures=[figure], legend=legend, kind="one",
                   folded="How the sensors are grouped, and what the network looks at")  # fmt: skip


# ---- where it errs


def _errors(facts: GrowthFacts) -> Section | None:
    """Errors by regime, after starts and stops, by recording."""
    shown = facts.shown
    if shown.verdict is None:
        return None
    made = _made(facts, "verdict.json")
    blocks: list[Block | None] = [
        _regimes_table(facts, made),
        _transitions(facts),
        _recordings_table(facts, made),
        default_section.outside_table(shown.verdict, made),
        default_section.left_out_table(shown.verdict, made),
    ]
    if shown.model is not None:
        blocks.append(default_section.training_table(shown.model, _made(facts, "model.json")))
    return Section(
        key="growth-errors",
        title="Spindle growth: where the model errs",
        text=[
            "A growth that is right when the spindle is warm may be wrong while it warms or cools, "
            "so the errors stand apart. The fixed interval is that of the temperatures alone; the "
            "other one follows the probe where one is left in the machine.",
        ],
        blocks=present(*blocks),
    )


def _regimes_table(facts: GrowthFacts, made: list[Source]) -> Table | None:
    """Errors and coverage while warming, cooling and steady."""
    things = [(name, score) for name in REGIMES if (score := facts.of_all(name)) is not None]

    def followed(name: str) -> str:
        score = facts.of_all(name, FOLLOWED)
        return _percent(None if score is None else score.coverage_90)

    columns: list[Column[tuple[str, Score]]] = [
        Column("While the spindle is", lambda one: one[0]),
        Column("samples", lambda one: number(one[1].n), unit=""),
        Column("MAE", lambda one: fixed(one[1].mae, 2), unit="µm"),
        Column("RMSE", lambda one: fixed(one[1].rmse, 2), unit="µm"),
        Column("largest error", lambda one: fixed(one[1].max, 1), unit="µm"),
        Column("fixed", lambda one: _percent(one[1].coverage_90), unit="%",
               group="Inside the 90 % interval"),
        Column("follows the probe", lambda one: followed(one[0]), unit="%",
               group="Inside the 90 % interval"),
    ]  # fmt: skip
    return tabulated(f"Errors by regime, {_judged_on(facts)}", things, columns, made)


def _recordings_table(facts: GrowthFacts, made: list[Source]) -> Table | None:
    """Errors of the model that serves, recording by recording, the worst first."""
    verdict = facts.shown.verdict
    faulty = {} if verdict is None else {
        c.case: joined([str(f.value).split()[1] for name, f in c.facts.items()
                        if name.startswith("faulty")] or ["–"])
        for c in verdict.cases
    }  # fmt: skip

    def speed(one: Score) -> str:
        value = condition(verdict, one.group, "highest speed")
        return "–" if value is None else number(round(value))

    columns: list[Column[Score]] = [
        Column("Recording", lambda one: code(short(one.group))),
        Column("highest speed", speed, unit="rev/min"),
        Column("samples", lambda one: number(one.n), unit=""),
        Column("MAE", lambda one: fixed(one.mae, 2), unit="µm"),
        Column("RMSE", lambda one: fixed(one.rmse, 2), unit="µm"),
        Column("largest error", lambda one: fixed(one.max, 1), unit="µm"),
        Column("bias", lambda one: signed(one.bias, 2), unit="µm"),
        Column("inside 90 % interval", lambda one: _percent(one.coverage_90), unit="%"),
        Column("faulty sensors", lambda one: faulty.get(one.group, "–")),
    ]  # fmt: skip
    things = facts.ranked()[::-1]
    return tabulated(f"Errors by recording ({len(things)})", things, columns, made,
                     most=MOST_ROWS, folded=True)  # fmt: skip


def _percent(share: float | None) -> str:
    return "–" if share is None else fixed(100 * share, 1)


def _transitions(facts: GrowthFacts) -> Figures | None:
    """Errors over the time since the spindle began to warm, and since it began to cool."""
    found = {
        regime: one for regime in (WARMING, COOLING)
        if (one := figures.transitions(facts.runs(regime))) is not None
    }  # fmt: skip
    if not found:
        return None
    reach = 1.1 * max([facts.limit or 0.1, *(one.widest for one in found.values())])
    drawn = []
    for regime, one in found.items():
        verb = "start or a higher speed" if regime == WARMING else "stop or a lower speed"
        caption = (
            f"After a {verb}: error of the model since the spindle began "
            f"{'to warm' if regime == WARMING else 'to cool'}, over {counted(one.count, 'time')}; "
            f"90 % of the samples lie within {_um(one.widest)}."
        )
        drawn.append(Figure(
            svg=figures.transition_figure(one, reach, facts.limit, caption), caption=caption,
            sources=_made(facts, "predictions.parquet"),
        ))  # fmt: skip
    legend = [("l-window", "median", "line"), ("s-band", "90 % of the samples", "box")]
    if facts.limit is not None:
        legend.append(("l-limit", f"limit of the largest error, ±{_um(facts.limit)}", "dots"))
    return Figures(figures=drawn, legend=legend)
