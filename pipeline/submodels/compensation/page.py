"""Page of the following error that the drives' model leaves over: before, after, which network."""

from collections.abc import Iterator

import numpy as np

from pipeline.charts import default_section
from pipeline.charts.numbers import TOGETHER, as_stated, counted, fixed, joined, number, percent
from pipeline.charts.sections import (
    Compared,
    Figure,
    Figures,
    PartVerdict,
    Section,
    SubModelPage,
    absent,
    present,
)
from pipeline.charts.tables import MOST_ROWS, Table, cells, code, names, numbers
from pipeline.schema.verdict import JudgedCase, Score
from pipeline.submodels.compensation import figures
from pipeline.submodels.compensation.model import (
    ATTENTIVE,
    ESTIMATION,
    FUZZY,
    NAMES,
    PREDICTION,
    TWIN,
    UseModel,
)
from pipeline.submodels.compensation.page_facts import (
    BASES,
    CompensationFacts,
    Seen,
    Traced,
    bare,
    short,
    um,
)

CLOSE_S = 0.4
"""Time before and after the greatest error that is drawn close [s]."""
SETTINGS = {
    "learning_rate": "learning rate", "l2": "penalty of the weights",
}  # fmt: skip
"""Settings of the search in words."""
NEEDS = (
    "It is learnt from commanded and measured positions of the axes at 500 Hz or more, in five "
    "recordings or more."
)


def page(shown: Seen) -> SubModelPage:
    """Everything that a machine's page says of the error that the drives' model leaves over."""
    facts = CompensationFacts(shown=shown)
    worst = _worst(facts)
    return SubModelPage(
        verdict=_verdict(facts),
        key_figures=_key_figures(facts),
        sections=[_before_and_after(facts), *_networks(facts)],
        compared={
            "compensation_rms_um": Compared(
                name="Following error not predicted, RMS of the worst axis", unit="um",
                value=max((s.rmse for _, _, s in worst if s.rmse is not None), default=None),
            ),
            "compensation_max_um": Compared(
                name="Following error not predicted, largest", unit="um",
                value=max((s.max for _, _, s in worst if s.max is not None), default=None),
            ),
        },
    )  # fmt: skip


def _worst(facts: CompensationFacts) -> list[tuple[str, str, Score]]:
    """Axis, use and errors over all recordings that decide."""
    return [
        (letter, use, score) for letter, use, _ in facts.axes
        if (score := facts.total(letter, use)) is not None
    ]  # fmt: skip


# ---- in words


def _use_words(use: str) -> str:
    return "predicted before the motion" if use == PREDICTION else "estimated from measurements"


def _axis_words(facts: CompensationFacts, letter: str, use: str, one: UseModel) -> str:
    """How far off an axis is on recordings that were not learnt from, with and without."""
    score = facts.total(letter, use)
    if score is None:
        return ""
    said = f"on {letter} by up to {um(score.max)} (RMS {um(score.rmse)}"
    base = facts.errors(score, BASES[use], one)
    if base is None or one.champion == BASES[use]:
        return f"{said})"
    return f"{said}; {_of_base(facts, use)} up to {um(base.max)}, RMS {um(base.rmse)})"


def _serving(facts: CompensationFacts, *, whole: bool = False) -> str:
    """Which networks serve, and that the published kind is not the best; ``whole`` with errors."""
    of: dict[str, list[str]] = {}
    for letter, _, one in facts.axes:
        of.setdefault(one.champion, []).append(letter)
    said = "; ".join(
        f"on {joined(letters)} {'no network' if kind in BASES.values() else _name(facts, kind)}"
        f" serves{f' ({_name(facts, kind)})' if kind in BASES.values() else ''}"
        for kind, letters in of.items()
    )
    beaten = [
        f"{letter} {um(one.scores[ATTENTIVE].rmse_um)} against "
        f"{um(one.scores[one.champion].rmse_um)}"
        for letter, _, one in facts.axes
        if ATTENTIVE in one.scores and one.champion in one.scores and one.champion != ATTENTIVE
    ]
    words = f"{said[:1].upper()}{said[1:]}."
    if beaten:
        words += f" The published kind of network, {NAMES[ATTENTIVE]}, is not the best here"
        words += f": RMSE on training recordings left out, {joined(beaten)}." if whole else "."
    return words


def _headline(facts: CompensationFacts) -> str:
    """All axes in one sentence or two; empty without a verdict."""
    said = []
    for use in (PREDICTION, ESTIMATION):
        axes = [
            words for letter, of, one in facts.axes
            if of == use and (words := _axis_words(facts, letter, use, one))
        ]  # fmt: skip
        if axes:
            groups = {s.group for letter, of, _ in facts.axes if of == use
                      for s, _ in facts.recordings(letter, use)}  # fmt: skip
            said.append(
                f"On {counted(len(groups), 'recording')} not learnt from, the following error "
                f"{_use_words(use)} is off {joined(axes)}."
            )
    return " ".join(said)


def _command(facts: CompensationFacts) -> str:
    return f"kerf simulate PROGRAM --machine {facts.shown.machine} --compensate FILE"


def _verdict(facts: CompensationFacts) -> PartVerdict | None:
    """How far off the axes are, who serves, what to do."""
    shown, verdict = facts.shown, facts.shown.verdict
    if shown.model is None and verdict is None:
        return None
    if verdict is None or verdict.status == "not judged":
        why = "; ".join(verdict.reasons) if verdict is not None and verdict.reasons else (
            "no recording was kept out of its fit"
        )  # fmt: skip
        return PartVerdict(
            status="unknown",
            sentence="The prediction of the following error that the drive model leaves over has "
            f"not been judged: {why.rstrip('.')}.",
            todo="Keep recordings of each axis out of the training set, to judge it by.",
        )
    if verdict.status == "failed":
        reason = verdict.reasons[0] if verdict.reasons else "the judge gave no reason"
        return PartVerdict(
            status="failed",
            sentence=f"The prediction of the following error failed: {reason.rstrip('.')}. "
            f"{_headline(facts)}".rstrip(),
            todo="Run no corrected command of this model; record further motions of the kind that "
            "is wrong.",
        )
    before = any(use == PREDICTION for _, use, _ in facts.axes)
    return PartVerdict(
        status="passed",
        sentence=f"{_headline(facts)} {_serving(facts)}".strip(),
        todo=f"To have a command that takes the error off before the motion: {_command(facts)}."
        if before
        else "Record the commanded positions too: only then can the command be corrected before "
        "the motion.",
    )


def _key_figures(facts: CompensationFacts) -> list[tuple[str, str, str]]:
    """Of the axis with the greatest error."""
    known = [one for one in _worst(facts) if one[2].max is not None]
    if not known:
        return []
    letter, use, score = max(known, key=lambda one: one[2].max or 0.0)
    one = next(m for axis, _, m in facts.axes if axis == letter)
    base = facts.errors(score, BASES[use], one)
    aside = f"worst axis, {letter}; RMS {um(score.rmse)}"
    if base is not None and one.champion != BASES[use]:
        aside += f"; {_of_base(facts, use)} {um(base.max)}"
    return [(f"Following error, {_use_words(use)}: largest error", um(score.max), aside)]


# ---- before and after


def _before_and_after(facts: CompensationFacts) -> Section:
    shown = facts.shown
    model = shown.model
    driven = model is None or model.with_drive
    key = "compensation"
    title = f"Following error{' that the drive model leaves over' if driven else ''}"
    if model is None:
        return Section(key=key, title=title, text=[absent(shown.folder / "model.json", NEEDS)])
    text = [
        "The model of the drives does not cover the whole following error: friction at reversals, "
        "ripple of the screw and the like remain. A network learns that rest from recordings."
        if model.with_drive
        else "This machine has no model of its drives, so the following error itself is learnt, "
        "not what such a model leaves over.",
        _headline(facts),
        _serving(facts, whole=True),
        *_limits_words(facts),
    ]
    if any(use == PREDICTION for _, use, _ in facts.axes):
        text.append(f"A command that takes the predicted error off: {_command(facts)}.")
    if shown.verdict is None:
        text.append(absent(shown.folder / "verdict.json",
                           "Errors are of training recordings left out in turn."))  # fmt: skip
    elif shown.verdict.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(shown.verdict.reasons) + ".")
    if shown.predictions is None:
        text.append(absent(shown.folder / "predictions.parquet",
                           "Without it no recording can be drawn."))  # fmt: skip
    tables = [_recordings_table(facts, *axis) for axis in facts.axes]
    return Section(
        key=key, title=title, text=[words for words in text if words],
        blocks=present(_along(facts), *tables),
    )  # fmt: skip


def _limits_words(facts: CompensationFacts) -> Iterator[str]:
    """What a reader must know of how it was learnt."""
    by_time = [letter for letter, _, one in facts.axes if one.by_time]
    if by_time:
        yield (
            f"Of {joined(by_time)} there are too few recordings to leave whole ones out: networks "
            "were chosen on stretches of time left out, which flatters them."
        )
    late = [letter for letter, use, _ in facts.axes if use == ESTIMATION]
    if late and facts.shown.model is not None:
        yield (
            f"Of {joined(late)} no command was recorded, so nothing can be predicted before the "
            "motion: the error is estimated from measurements that are "
            f"{number(1e3 * facts.shown.model.horizon_s)}{TOGETHER}ms old or older."
        )


def _along(facts: CompensationFacts) -> Figures | None:
    """The recording of the first axis with the greatest error, whole and close."""
    for letter, use, one in facts.axes:
        trace = facts.traced(letter, use, one)
        if trace is None or len(trace.seconds) < 2:
            continue
        return _drawn(facts, trace, one)
    return None


def _drawn(facts: CompensationFacts, trace: Traced, one: UseModel) -> Figures:
    first, last = float(trace.seconds[0]), float(trace.seconds[-1])
    at = float(trace.seconds[trace.worst])
    close = (max(first, at - CLOSE_S), min(last, at + CLOSE_S))
    serves = one.champion != BASES[trace.use]
    before, after = (_peak(e) for e in (trace.before, trace.after))
    gone = f"; {_name(facts, one.champion)} leaves up to {um(after)}" if serves else ""
    what = f"Axis {trace.axis} in {short(trace.case)}"
    words = (
        f"{what}, not learnt from: {_of_base(facts, trace.use)}, error up to {um(before)}{gone}.",
        f"{what} at its greatest error, {fixed(close[0], 1)} to {fixed(close[1], 1)}{TOGETHER}s.",
    )
    heads = (
        f"Error, {_of_base(facts, trace.use)}, and as predicted, µm",
        f"Error left, {_name(facts, one.champion)}, µm",
    )
    return Figures(
        figures=[
            Figure(svg=figures.error_figure(trace, span, heads, said), caption=said,
                   sources=facts.made_from("predictions.parquet"))
            for span, said in zip(((first, last), close), words, strict=True)
        ],
        legend=[("l-measured", "measured", "line"), ("l-window", "predicted", "line"),
                ("s-band", "its 90 % interval", "box")],
    )  # fmt: skip


def _of_base(facts: CompensationFacts, use: str) -> str:
    """What a use is held against, in the middle of a sentence."""
    if use == ESTIMATION:
        return "last error known"
    with_drive = facts.shown.model is not None and facts.shown.model.with_drive
    return "drive model alone" if with_drive else "nothing predicted"


def _peak(values: np.ndarray) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


def _recordings_table(
    facts: CompensationFacts, letter: str, use: str, one: UseModel
) -> Table | None:
    """Recordings that were not learnt from by the drives' model alone and by each network."""
    rows = facts.recordings(letter, use)
    if not rows:
        return None
    total = facts.total(letter, use)
    judged = () if total is None else total.baselines
    kinds = [
        BASES[use], *(kind for kind in (FUZZY,) if kind in judged),
        *(kind for kind in one.scores if kind != BASES[use]),
    ]  # fmt: skip
    every: list[tuple[Score, JudgedCase | None]] = [
        *rows[:MOST_ROWS], *([(total, None)] if total is not None else [])
    ]  # fmt: skip
    unit = next((f.unit for _, c in rows if (f := facts.speed(c, letter)) is not None), "")
    return Table(
        caption=f"Axis {letter}, {_use_words(use)}: RMS and greatest error on recordings not "
        "learnt from",
        heads=[
            *names("Recording"), *numbers(("highest speed", "mm/min" if unit == "mm/s" else unit)),
            *names("speed learnt"),
            *numbers(*((_name(facts, k) + " (serves)" * (k == one.champion), "µm") for k in kinds),
                     group="RMS / greatest error"),
            *numbers(("of the greatest error gone", "%")),
        ],
        rows=[
            cells(
                code(short(score.group)) if score.group != "all" else "all together",
                _speed_words(facts, case, letter),
                "–" if case is None else "no" if facts.new_speed(case, letter) else "yes",
                *(_pair(facts, score, kind, one) for kind in kinds),
                _gone(facts, score, use, one),
            )
            for score, case in every
        ],
        sources=facts.made_from("verdict.json"),
        note="Speed learnt: whether a recording that was learnt from reaches the same highest "
        "speed. A minus: the greatest error is larger with the network than without.",
    )  # fmt: skip


def _name(facts: CompensationFacts, kind: str) -> str:
    """A kind in words; without a model of the drives its baseline predicts nothing."""
    return _of_base(facts, PREDICTION) if kind == TWIN else NAMES.get(kind, kind)


def _speed_words(facts: CompensationFacts, case: JudgedCase | None, letter: str) -> str:
    found = facts.speed(case, letter)
    if found is None or not isinstance(found.value, float | int):
        return "–"
    return number(round(60 * found.value)) if found.unit == "mm/s" else number(found.value)


def _pair(facts: CompensationFacts, score: Score, kind: str, one: UseModel) -> str:
    found = facts.errors(score, kind, one)
    return "–" if found is None else f"{bare(found.rmse)} / {bare(found.max)}"


def _gone(facts: CompensationFacts, score: Score, use: str, one: UseModel) -> str:
    base = facts.errors(score, BASES[use], one)
    if base is None or not base.max or score.max is None:
        return "–"
    return fixed(100 * (1 - score.max / base.max), 0)


# ---- which network


def _networks(facts: CompensationFacts) -> list[Section]:
    """Networks compared, where the attention looks, the search, the leak."""
    model = facts.shown.model
    if model is None:
        return []
    return [
        Section(
            key="compensation-networks",
            title="Following error: networks compared",
            text=[
                "Each network was trained several times, each time without some of the training "
                "recordings, and compared on those. The one with the least RMSE serves. ARX is the "
                "linear one; persistence takes the last error known to stay.",
                *_leak_words(facts),
                *_search_words(facts),
            ],
            blocks=present(
                _bars(facts), _attention(facts), _history(facts),
                default_section.training_table(model, facts.made_from("model.json")),
            ),
        )
    ]  # fmt: skip


def _leak_words(facts: CompensationFacts) -> Iterator[str]:
    """What the published inputs would seem to gain."""
    model = facts.shown.model
    leak = None if model is None else model.leak
    if leak is not None:
        gain = "" if leak.rmse_um < leak.honest_um else ", and here it would gain nothing"
        yield (
            f"With the measured position among the inputs, as published, the RMS error of "
            f"{leak.axis} on recordings left out would read {um(leak.rmse_um)} instead of "
            f"{um(leak.honest_um)} ({NAMES.get(leak.kind, leak.kind)}). Nobody knows that position "
            f"before the motion{gain}: such inputs are refused."
        )


def _search_words(facts: CompensationFacts) -> Iterator[str]:
    """What a search found, and whose bounds it hit."""
    model = facts.shown.model
    search = None if model is None else model.search
    if search is None:
        return
    chosen = joined(
        [f"{_setting(n)} {as_stated(v, 3)}" for n, v in search.chosen.items()] or ["none"]
    )
    yield (
        f"Settings of {NAMES.get(search.kind, search.kind)} were searched on {search.axis} "
        f"({search.method}): {counted(search.candidates, 'candidate')} trained, "
        f"{number(search.pruned)} of them stopped early. Chosen: {chosen}."
    )
    if search.bounds_hit:
        hit = joined([f"{_setting(n)} ({end})" for n, end in search.bounds_hit.items()])
        yield f"The best value lies on a bound of {hit}: a wider search may find better."


def _setting(name: str) -> str:
    last = name.rpartition(".")[2]
    return SETTINGS.get(last, last.replace("_", " "))


def _bars(facts: CompensationFacts) -> Figures | None:
    """RMSE of every network on training recordings left out, of every axis and use."""
    model = facts.shown.model
    if model is None or not facts.axes:
        return None
    every = [
        (letter, use, uses[use]) for use in (PREDICTION, ESTIMATION)
        for letter, uses in model.axes.items() if use in uses
    ]  # fmt: skip
    most = 1.12 * max(
        (s.rmse_um + s.spread_um for _, _, one in every for s in one.scores.values()), default=0.0
    )
    drawn = []
    for letter, use, one in every:
        rows = [
            (_name(facts, kind), score.rmse_um, score.spread_um, kind == one.champion)
            for kind, score in sorted(one.scores.items(), key=lambda s: s[1].rmse_um)
        ]
        caption = (
            f"Axis {letter}, {_use_words(use)}: RMSE on "
            f"{'stretches of time' if one.by_time else 'training recordings'} left out. "
            f"{rows[0][0]} errs least."
        )
        head = f"Axis {letter}, {_use_words(use)}"
        drawn.append(Figure(svg=figures.bars_figure(rows, most or 1.0, head, caption),
                            caption=caption, sources=facts.made_from("model.json")))  # fmt: skip
    legend = [("s-after", "serves", "box"), ("s-before", "others", "box"),
              ("l-asked", "± one standard deviation over trainings", "line")]  # fmt: skip
    return Figures(figures=drawn, legend=legend)


def _attention(facts: CompensationFacts) -> Figures | None:
    """Where the network with attention looks, by regime."""
    one = None if facts.shown.model is None else facts.shown.model.attention
    if one is None or not one.weights:
        return None
    caption = (
        f"Axis {one.axis}, {NAMES[ATTENTIVE]}: mean weight of its attention over the window, on a "
        "motion to and fro at half of the highest speed learnt."
    )
    return Figures(
        figures=[Figure(svg=figures.attention_figure(one, caption), caption=caption,
                        sources=facts.made_from("model.json"))],
        legend=[(f"l-{figures.REGIME_CURVES[name]}", name, "line") for name in one.weights],
        kind="one", folded="Where the network with attention looks",
    )  # fmt: skip


def _history(facts: CompensationFacts) -> Figures | None:
    """Best validation error by generation."""
    model = facts.shown.model
    search = None if model is None else model.search
    if search is None or not search.history_um:
        return None
    history = np.array(search.history_um, float)
    gain = percent(float(history[0] - history[-1]), float(history[0]))
    caption = (
        f"Search of the settings of {NAMES.get(search.kind, search.kind)} on {search.axis}: best "
        f"RMSE after each generation, from {um(float(history[0]))} to {um(float(history[-1]))} "
        f"({gain} less)."
    )
    return Figures(
        figures=[Figure(svg=figures.history_figure(history, caption), caption=caption,
                        sources=facts.made_from("model.json"))],
        kind="one", folded="How the settings were searched",
    )  # fmt: skip
