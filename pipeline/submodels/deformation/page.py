"""Page of spindle growth: the first hour, faulty sensors, all methods, what the model is off by."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.charts.numbers import NARROW, TOGETHER, counted, fixed, joined, number, signed
from pipeline.charts.sections import (
    Action,
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
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.schema.verdict import Score
from pipeline.signals.store import parquet_name
from pipeline.submodels.deformation import figures
from pipeline.submodels.deformation.growth_facts import (
    FirstHour,
    GrowthFacts,
    Seen,
    SensorFault,
    condition,
    judged_on,
    made_from,
    short,
    um,
    whole_um,
)
from pipeline.submodels.deformation.records import AMBIENT, GROWTH, SPEED
from pipeline.submodels.deformation.sensors import DEAD


def page(shown: Seen) -> SubModelPage:
    """Everything that a machine's page says of its spindle's growth."""
    from pipeline.submodels.deformation.page_sections import compared_section, errors_section

    facts = GrowthFacts(shown=shown)
    return SubModelPage(
        verdict=_verdict(facts),
        key_figures=_key_figures(facts),
        actions=_actions(facts),
        notes=_notes(facts),
        sections=[
            _expected(facts),
            *present_sections(compared_section(facts), errors_section(facts)),
        ],
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
        f"In its first hour{at} the spindle grows by up to {whole_um(hour.growth)} "
        f"({_interval_words(facts, hour)})"
    )


def _interval_words(facts: GrowthFacts, hour: FirstHour) -> str:
    unknown = facts.shown.verdict is not None and facts.shown.verdict.unknown_intervals
    if unknown and (GROWTH, "") in unknown:
        return "90 % interval not known"
    return f"90 % interval {fixed(hour.low, 0)} to {whole_um(hour.high)}"


def _warm_words(facts: GrowthFacts) -> str:
    """How long to warm up."""
    hour = facts.first_hour
    if hour is None:
        return ""
    at = f" at {_speed_words(hour.speed)}" if hour.speed is not None else ""
    rest = f" (the rest of the hour then moves less than {whole_um(hour.within_um)})"
    sure = facts.shown.verdict is not None and facts.shown.verdict.status == "passed"
    return (
        f"warm up for {fixed(np.ceil(hour.settled_min), 0)}{TOGETHER}min{at} before finishing "
        f"cuts{rest if sure else ' and measure what it then still grows'}"
    )


def sensor_words(fault: SensorFault) -> str:
    """What is wrong with a sensor and since when, without a full stop."""
    off = ""
    if fault.worst_K is not None:
        side = "high" if fault.worst_K > 0 else "low"
        off = f", reads up to {fixed(abs(fault.worst_K), 1)}{TOGETHER}K too {side}"
    return (
        f"{fault.sensor} is {fault.kind} since {short(fault.case)}, minute "
        f"{fixed(fault.minute, 0)} ({fault.moment}){off}, in {counted(fault.cases, 'recording')}, "
        f"last in {short(fault.last)}"
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


def _actions(facts: GrowthFacts) -> list[Action]:
    """Sensors to be mended, and how to keep the growth out of finishing cuts."""
    found = [
        Action(
            what="Reconnect or replace the sensor" if one.kind == DEAD else "Replace the sensor",
            where=f"{one.sensor} ({one.place})",
            why=f"It {sensor_words(one).removeprefix(one.sensor).strip()}. "
            "The model does without it.",
            until="next stop", who="maintenance", evidence="growth-errors",
        )
        for one in facts.faults if one.lasts
    ]  # fmt: skip
    verdict, warm = facts.shown.verdict, _warm_words(facts)
    if warm and verdict is not None and verdict.status in ("passed", "failed"):
        why = f"{_hour_words(facts)}."
        if verdict.status == "failed":
            why += f" That model failed: {_failure(facts)}."
        found.append(Action(what=warm[:1].upper() + warm[1:], where="Spindle", why=why,
                            until="before finishing cuts", who="process engineer",
                            evidence="growth"))  # fmt: skip
    return found


def _cost_words(facts: GrowthFacts) -> str:
    """What the faulty sensors cost as they are, and with the others in their place."""
    if facts.cost is None:
        return ""
    as_is, replaced = facts.cost
    return (
        f"Read as they are they would put the predicted growth off by up to {whole_um(as_is)}; "
        f"the model does without them and is off by up to {um(replaced)}."
    )


def _verdict(facts: GrowthFacts) -> PartVerdict | None:
    """What growth is to be expected and what to do; the status of the judgement."""
    shown, verdict = facts.shown, facts.shown.verdict
    if shown.model is None and verdict is None:
        return None
    hour = _hour_words(facts)
    if verdict is None or verdict.status == "not judged":
        why = "; ".join(verdict.reasons) if verdict is not None and verdict.reasons else (
            "no recording was kept out of its fit"
        )  # fmt: skip
        return PartVerdict(
            status="unknown",
            sentence=f"{hour}{'; but the' if hour else 'The'} model of the spindle’s growth has "
            f"not been judged: {why.rstrip('.')}.",
            todo="Record further speed profiles that the model is not fitted on.",
        )
    warm = _warm_words(facts)
    if verdict.status == "failed":
        advice = (
            "Load no correction from this model; "
            f"{warm or 'measure the growth before finishing cuts'}."
        )
        return PartVerdict(
            status="failed",
            sentence=f"{hour}{'; but the' if hour else 'The'} model of that growth failed on "
            f"{judged_on(facts)}: {_failure(facts)}. {advice}",
            todo="Load no correction from this model.",
        )
    command = f"kerf compensation --machine {shown.machine} --out FILE"
    loads = f"load the correction ({command}), which leaves up to {um(_largest(facts))}"
    advice = f"{warm}, or {loads}" if warm else loads
    return PartVerdict(
        status="passed",
        sentence=f"{hour}{'; the' if hour else 'The'} model of that growth passed on "
        f"{judged_on(facts)}: it is off by {um(_largest(facts))} at most"
        f"{_limit_words(facts)}.",
        todo=_sentence(advice),
    )


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."


def _failure(facts: GrowthFacts) -> str:
    """By how much and where it missed its limit; else the judge's gravest reason."""
    worst = max(facts.ranked(), key=lambda s: s.max or 0.0, default=None)
    if worst is not None and facts.limit is not None and (worst.max or 0.0) > facts.limit:
        return f"it is off by up to {um(worst.max)} in {short(worst.group)}{_limit_words(facts)}"
    reasons = () if facts.shown.verdict is None else facts.shown.verdict.reasons
    return reasons[0] if reasons else "the judge gave no reason"


def _limit_words(facts: GrowthFacts) -> str:
    return "" if facts.limit is None else f" (limit {um(facts.limit)})"


def _largest(facts: GrowthFacts) -> float | None:
    return None if facts.total is None else facts.total.max


def _key_figures(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    found = []
    if facts.total is not None:
        found.append(("Largest error of growth", um(_largest(facts)),
                      f"recordings held out{_limit_words(facts)}"))  # fmt: skip
    if (hour := facts.first_hour) is not None:
        aside = _interval_words(facts, hour)
        if hour.speed is not None:
            aside += f", at up to {_speed_words(hour.speed)}"
        found.append(("Growth in the first hour", whole_um(hour.growth), aside))
    if facts.faults:
        lasting = ", ".join(one.sensor for one in facts.faults)
        found.append(("Faulty temperature sensors", str(len(facts.faults)), lasting))
    return found


def _notes(facts: GrowthFacts) -> list[str]:
    said = []
    if facts.faults:
        todo = _mend(facts.faults) or "Temperature sensors"
        said.append(f"{todo}: {'; '.join(map(sensor_words, facts.faults))}. "
                    f"{_cost_words(facts)}".rstrip())  # fmt: skip
    return said


# ---- what to expect


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
        "model gives the growth since the start from the temperatures along the spindle, its speed "
        "and the air, so that the control can take it off.",
    ]
    if (hour := facts.first_hour) is not None:
        text.append(
            f"{_hour_words(facts)}: the largest of {counted(hour.others, 'recording')} that last "
            f"an hour, {short(hour.case)}, where the probe read {whole_um(hour.measured)} at that "
            f"time. From minute {fixed(hour.settled_min, 0)} the rest of that hour moves less than "
            f"{whole_um(hour.within_um)}."
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
        Column("where it sits", lambda one: one.place),
        Column("is", lambda one: Cell(text=one.kind, status="failed")),
        Column("since recording", lambda one: short(one.case)),
        Column("at minute", lambda one: fixed(one.minute, 0), unit=""),
        Column("date", lambda one: one.moment),
        Column("off by up to", lambda one: "–" if one.worst_K is None else signed(one.worst_K),
               unit="K"),
        Column("recordings", lambda one: number(one.cases), unit=""),
        Column("last in", lambda one: short(one.last)),
        Column("what to do", _sensor_todo),
    ]  # fmt: skip
    return tabulated("Faulty temperature sensors", facts.faults, columns,
                     made_from(facts, "verdict.json"), note=_cost_words(facts))  # fmt: skip


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
            f"{words}, {short(score.group)}{at}: RMSE {um(score.rmse, 2)}, largest error "
            f"{um(score.max)}."
        )
        drawn.append(Figure(
            svg=figures.recording_figure(one, facts.limit, caption), caption=caption,
            sources=[*made_from(facts, "predictions.parquet"), *_trace_source(facts, score.group)],
        ))  # fmt: skip
    legend = [("l-measured", "growth measured", "line"), ("l-window", "growth modelled", "line"),
              ("s-band", "its 90 % interval", "box")]  # fmt: skip
    if facts.limit is not None:
        legend.append(("l-limit", f"limit of the largest error, ±{um(facts.limit)}", "dots"))
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
