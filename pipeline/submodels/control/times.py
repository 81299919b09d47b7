"""Predicted times of runs, with their 90 % interval.

A half width is a share of the predicted time, by type of row: conformal over programs, each
predicted by a control that was identified from the others.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.spindle import CUTTING
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Band, Bands
from pipeline.schema.verdict import Fact
from pipeline.submodels.conformal import Residuals, bands, half_widths, splits
from pipeline.submodels.contract import Prediction
from pipeline.submodels.control.fit import ControlFit, ControlFitSettings, identify_control
from pipeline.submodels.control.programs import Match
from pipeline.submodels.control.runs import stopped_within
from pipeline.submodels.control.segments import Observed, shares
from pipeline.twin.control import WHOLE, control_of_unit, dwells, planned_program
from pipeline.twin.simulation import type_of

TIME = "run time"
"""Quantity: time of a whole run, or of its rows of one type, without the operator's stops [s]."""
DWELL = "dwell"
"""Regime of the rows that the control times by its own clock."""
WAIT = 1.0
"""Excess over the planned M0 or M1 from which the operator is taken to wait [s]."""
NAIVE, OVERRIDE_ONLY = "path over programmed feed", "recorded override only"
"""Baselines: no acceleration or waiting; overrides as recorded, feeds not read from speeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedRun:
    """A run with its program, and the segments of the parts that are of this program."""

    match: Match
    observed: tuple[Observed, ...]


def time_bands(
    runs: Sequence[MatchedRun], start: ControlParameters, settings: ControlFitSettings,
    fit: ControlFit,
) -> dict[str, Band]:  # fmt: skip
    """Half widths of the 90 % interval of a time as shares of it [1], by type of row.

    Runs of a program are left out together, where another program ran on the same machine; else
    they are left out one by one, and the only run of a machine is not.  Empty where fewer than two
    groups can be left out.
    """
    units = Counter(run.observed[0].unit for run in runs if run.observed)
    whole = [
        run for run in runs
        if run.match.whole and run.match.run.completed
        and run.observed and units[run.observed[0].unit] > 1
    ]  # fmt: skip
    groups: dict[str, list[MatchedRun]] = {}
    for run in whole:
        groups.setdefault(_left_together(run, whole), []).append(run)

    tasks = []
    for _, others in splits(list(groups), settings.folds):
        out = {id(run) for name in others for run in groups[name]}
        tasks.append(
            _Task(
                observed=[part for run in runs if id(run) not in out for part in run.observed],
                left={name: groups[name] for name in others}, start=start, settings=settings,
                near=fit,
            )
        )  # fmt: skip
    residuals = Residuals.joined(mapped(_left_over, tasks))
    found = bands(residuals) if np.isfinite(residuals.error).any() else {}
    return {
        name: replace(band, lower=float(f"{band.lower:.4g}"), upper=float(f"{band.upper:.4g}"))
        for name, band in found.items()
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """A fold: what a control is identified from, and the runs that it is to predict, by group."""

    observed: Sequence[Observed]
    left: Mapping[str, Sequence[MatchedRun]]
    start: ControlParameters
    settings: ControlFitSettings
    near: ControlFit


def _left_over(task: _Task) -> Residuals:
    """Shares by which a control misses the times of runs that it was not identified from."""
    controls = identify_control(task.observed, task.start, task.settings, task.near).control
    return Residuals.joined(
        _residuals(run, name, controls) for name, runs in task.left.items() for run in runs
    )


def _left_together(run: MatchedRun, runs: Sequence[MatchedRun]) -> str:
    """The group that a run is left out with: its program, or itself."""
    own = run.observed[0]
    others = {one.observed[0].program for one in runs if one.observed[0].unit == own.unit}
    return f"{own.program}@{own.unit}" if len(others) > 1 else run.match.run.name


def _residuals(run: MatchedRun, group: str, controls: Mapping[str, ControlParameters]) -> Residuals:
    frame = predicted(run, controls).frame
    frame = frame[frame["predicted"] > frame["exact"]]
    error = (frame["measured"] - frame["predicted"]).to_numpy(float)
    share = error / (frame["predicted"] - frame["exact"]).to_numpy(float)
    return Residuals(
        error=share, regime=frame["regime"].to_numpy(dtype=str), t=np.zeros(len(frame)),
        group=np.full(len(frame), group),
    )  # fmt: skip


def predicted(
    run: MatchedRun, controls: Mapping[str, ControlParameters], intervals: Bands | None = None,
    ends: Mapping[str, Sequence[ControlParameters]] | None = None,
) -> Prediction:  # fmt: skip
    """Time of one run beside that measured; nothing of a run of another revision.

    Its interval reaches as far as the controls that the runs leave open, ``ends`` by unit, and as
    the stamps of the log may be late.
    """
    if not run.match.whole or not run.observed:
        return Prediction(frame=pd.DataFrame(), note=run.match.reason)
    one = run.observed[0]
    control = control_of_unit(controls, one.unit)
    times = planned_program(one.moves, control, one.overrides).time
    as_said = replace(one.overrides, feed=one.operator.said[one.moves.line])
    said = planned_program(one.moves, control, as_said).time
    rapid = min(axis.rapid_speed for axis in control.axes.values())
    naive = naive_times(one.moves, one.operator.feed[one.moves.line], rapid)
    end, until = _seen_until(one)
    stops = _stops(one, times, end)
    measured = end - one.run.start - stops
    modelled, plain, recorded = (float(t[:until].sum()) for t in (times, naive, said))
    rows: list[dict[str, Any]] = [
        {
            "regime": WHOLE, "measured": measured, "predicted": modelled,
            f"baseline_{NAIVE}": plain, f"baseline_{OVERRIDE_ONLY}": recorded,
        }
    ]  # fmt: skip
    by_type = shares(one, times)
    rows += [
        {"regime": word, "measured": share.measured, "predicted": share.predicted}
        for word, share in by_type.items()
    ]
    frame = pd.DataFrame(rows).assign(quantity=TIME, unit="s", t=0.0)
    dwell, ticks = dwells(one.moves.part(0, until), control)
    timed = frame["regime"].isin((WHOLE, DWELL)).to_numpy(bool)
    frame["exact"] = np.where(timed, np.minimum(dwell, frame["predicted"]), 0.0)
    if intervals:
        exact, regime = frame["exact"].to_numpy(float), frame["regime"].to_numpy(dtype=str)
        rest, tick = frame["predicted"].to_numpy(float) - exact, np.where(timed, ticks, 0.0)
        stamps = [one.run.latency, *(share.late for share in by_type.values())]
        opened = _opened(one, times, until, (ends or {}).get(one.unit, ()), by_type)
        lower, upper = (
            np.sqrt((half * rest) ** 2 + np.square(stamps) + open_**2)
            for half, open_ in zip(half_widths(regime, intervals), opened, strict=True)
        )
        frame["low"] = frame["predicted"] - tick - lower
        frame["high"] = frame["predicted"] + tick + upper
    # a run that was aborted is compared up to the last line that was seen, and decides nothing
    frame["scored"] = one.run.completed and measured > 0
    return Prediction(
        frame=frame,
        facts={
            "program": Fact(value=one.program),
            "measured": Fact(value=round(measured, 2), unit="s"),
            "predicted": Fact(value=round(modelled, 2), unit="s"),
            "error": Fact(value=_percent(modelled, measured), unit="%"),
            NAIVE: Fact(value=round(plain, 2), unit="s"),
            f"error of {NAIVE}": Fact(value=_percent(plain, measured), unit="%"),
            f"error of {OVERRIDE_ONLY}": Fact(value=_percent(recorded, measured), unit="%"),
            "stops": Fact(value=round(stops, 2), unit="s"),
            "completed": Fact(value="yes" if one.run.completed else "no"),
            "feed read from speeds": Fact(value=round(one.operator.feed_read, 3), unit="1"),
        },
        note="" if one.run.completed else "the run was aborted; compared up to its last line",
    )


def _opened(
    one: Observed, times: Floats, until: int, ends: Sequence[ControlParameters],
    types: Iterable[str],
) -> tuple[Floats, Floats]:  # fmt: skip
    """Differences of the times of the whole run and its ``types`` at the ``ends`` [s]."""
    kind = type_of(one.moves.kind[:until])
    change = np.zeros((1 + len(ends), until))
    for k, end in enumerate(ends, start=1):
        change[k] = (planned_program(one.moves, end, one.overrides).time - times)[:until]
    each = np.array([change.sum(axis=1), *(change[:, kind == w].sum(axis=1) for w in types)])
    return each.min(axis=1), each.max(axis=1)


def naive_times(moves: Moves, feed_factor: Floats, rapid_speed: float) -> Floats:
    """Path over programmed feed, without acceleration or waiting, as by simple estimators [s].

    ``feed_factor`` is the feed override, (rows,) [1]; ``rapid_speed`` [mm/min] that of rapids, and
    of cuts whose feed is not in mm/min.
    """
    cutting = np.isin(moves.kind, CUTTING)
    timed = cutting & (moves.feed > 0) & (moves.feed_mode == FeedMode.PER_MINUTE)
    speed = np.where(timed, moves.feed * feed_factor, rapid_speed)
    times: Floats = np.where(cutting | (moves.kind == Kind.RAPID), moves.length / speed * 60, 0.0)
    return times


def _seen_until(one: Observed) -> tuple[float, int]:
    """Time at which the last line was seen [s], and the number of rows executed until then."""
    if one.run.completed or not len(one.after):
        return one.run.end, len(one.moves) if one.run.completed else 0
    return float(one.end[-1]), int(one.after[-1])


def _stops(one: Observed, times: Floats, end: float) -> float:
    """Time that the machine was held, and time at M0 and M1 beyond the machine's own [s]."""
    start = np.array([one.run.start])
    stopped = float(stopped_within(one.operator.stops, start, np.array([end]))[0])
    for first, after, measured in zip(one.first, one.after, one.measured, strict=True):
        rows = slice(first, after)
        if (one.moves.kind[rows] == Kind.STOP).any():
            stopped += max(0.0, float(measured - times[rows].sum()) - WAIT)
    return stopped


def _percent(predicted: float, measured: float) -> float | None:
    return round(100 * (predicted / measured - 1), 2) if measured > 0 else None
