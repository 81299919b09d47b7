"""State of the twin over single recordings: trend of vibration, force against the dynamometer.

The vibration of a cut is the RMS of its windows from 10 to 1000 Hz.  Expected at its conditions is
a log-linear regression on them and on the wear, fitted robustly to the other tools,

    ln RMS = c_0 + sum_i c_i ln x_i + c_w VB + words,

with x_i itself where it is not above 0 throughout,
at the level of the tool's own earlier cuts of the same kind: how resonances answer a speed that no
other tool has run at, conditions do not say.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.cutting.force.force_law import N_MM, N_MM2
from pipeline.monitoring.day_estimates import spindle_power
from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.predictions import write_predictions
from pipeline.schema.twin_state import RECORDINGS, ForceCheck, TrendCheck
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.cases import Records, role_of
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands
from pipeline.submodels.cutting.spindle_load.identify import load_logs
from pipeline.submodels.cutting.spindle_load.levels import load_levels
from pipeline.submodels.cutting.spindle_load.readings import cut_log, program_lines, read_log

BAND_HZ = (10.0, 1000.0)
"""Band of the vibration's RMS [Hz] (Twin2026)."""
LEAST_CORRELATION, MOST_PERCENT = 0.85, 20.0
"""Correlation of vibration [1] and mean absolute error of force [%] as targets (Twin2026)."""
RIDGE = 0.01
"""Penalty of the regression on standardised conditions [1]: those that always change together
share their effect."""
SILENT = 0.05
"""Share of a tool's usual RMS below which a sensor shows nothing of a cut [1]."""
EARLIER, FEWEST_TOOLS = 2, 3
"""Cuts of a tool from which its level is known; tools from which on there is a correlation."""


def band_rms(values: Any, rate_Hz: float, band_Hz: tuple[float, ...]) -> Floats:
    """RMS of windows (..., L) within a band, by Parseval's theorem; the band's ends count.

    >>> t = np.arange(500) / 5000.0
    >>> wave = np.sqrt(2) * (np.sin(2 * np.pi * 100 * t) + 5 * np.sin(2 * np.pi * 2000 * t))
    >>> round(float(band_rms(wave, 5000.0, (10.0, 1000.0))), 6)
    1.0
    """
    length = values.shape[-1]
    share = np.abs(np.fft.rfft(values, axis=-1) / length) ** 2
    frequency = np.fft.rfftfreq(length, 1 / rate_Hz)
    twice = np.where((frequency > 0) & (frequency < rate_Hz / 2), 2.0, 1.0)
    inside = (frequency >= band_Hz[0] - 1e-9) & (frequency <= band_Hz[1] + 1e-9)
    return np.sqrt((share * twice)[..., inside].sum(axis=-1))


def recorded_trends(
    serving: ServingModel | None, records: Records, sets: GoldenSets | None, out: Path
) -> tuple[TrendCheck, ...]:
    """Vibration of each recorded cut beside what is expected of it; writes ``recordings.parquet``.

    ``serving``: the champion's wear model, whose settings name the recordings; none without.
    Sealed tools are not looked at.
    """
    (out / RECORDINGS).unlink(missing_ok=True)
    lives = serving.one.cases(records, serving.judging, sets).cases if serving else ()
    windows = [case.load() for case in lives if case.role != "sealed"]
    if not windows:
        return ()
    every = WearWindows.joined(windows)
    channels = [k for k, name in enumerate(every.channels)
                if every.units[k] == "m/s^2" or name.startswith("vibration")]  # fmt: skip
    low, high = BAND_HZ
    if every.rate_Hz < 2 * high or every.rate_Hz / every.values.shape[2] > low * (1 + 1e-9):
        why = (f"windows of {every.values.shape[2]} samples at {every.rate_Hz:g} Hz do not hold "
               f"{low:g} to {high:g} Hz: record faster, or take longer windows")  # fmt: skip
        return tuple(TrendCheck(quantity=every.channels[k], least=LEAST_CORRELATION, reason=why)
                     for k in channels)  # fmt: skip
    _, first, member = np.unique(every.recording, return_index=True, return_inverse=True)
    power = pd.DataFrame(band_rms(every.values[:, channels], every.rate_Hz, BAND_HZ) ** 2)
    rms = np.sqrt(power.groupby(member).mean().to_numpy())
    cuts = every.of(first)
    trends = [_trend(cuts, measured, every.channels[k], every.units[k])
              for k, measured in zip(channels, rms.T, strict=True)]  # fmt: skip
    if trends:
        write_predictions(pd.concat([table for table, _ in trends]), out / RECORDINGS)
    return tuple(check for _, check in trends)


def _trend(
    cuts: WearWindows, rms: Floats, quantity: str, unit: str
) -> tuple[pd.DataFrame, TrendCheck]:
    """Predictions of one channel's RMS (N,), and how they correlate with what was measured."""
    conditions = pd.DataFrame(cuts.conditions)
    words = [name for name in cuts.conditions if name not in cuts.condition_units]
    kind = conditions[words].astype(str).agg(", ".join, axis=1) if words else ""
    table = pd.DataFrame({
        "case": cuts.recording, "group": cuts.tool, "role": "held_out", "quantity": quantity,
        "unit": unit, "regime": kind, "t": cuts.progress, "measured": rms, "predicted": np.nan,
        "low": np.nan, "high": np.nan, "scored": True,
    })  # fmt: skip
    usual = table.groupby("group")["measured"].transform("median")
    log = np.log(table["measured"].where(rms > SILENT * usual))
    new = _expected(log, cuts, conditions, words)
    life = (log - new).iloc[np.argsort(cuts.progress, kind="stable")].dropna()
    level = life.groupby([table["group"], table["regime"]]).transform(
        lambda own: own.expanding(EARLIER).median().shift()
    )
    expected = new + level.reindex(new.index)
    off = (log - expected).dropna()
    tools = table["group"][off.index]
    check = TrendCheck(quantity=quantity, recordings=len(off), tools=tools.nunique(),
                       least=LEAST_CORRELATION)  # fmt: skip
    measured = table["measured"][off.index]
    r = [measured.corr(np.exp(one[off.index])) for one in (expected, new)]
    if tools.nunique() < FEWEST_TOOLS or not np.isfinite(r).all():
        why = (f"fewer than {FEWEST_TOOLS} tools of known wear with {EARLIER + 1} cuts of a kind, "
               "or cuts that do not differ")  # fmt: skip
        return table, replace(check, reason=why)
    residuals = Residuals(error=off.to_numpy(), regime=np.full(len(off), ALL_REGIMES),
                          group=tools.to_numpy(str), t=np.zeros(len(off)))  # fmt: skip
    half = bands(residuals)[ALL_REGIMES].upper
    return table.assign(
        predicted=np.exp(expected), low=np.exp(expected - half), high=np.exp(expected + half),
        baseline_new_tool=np.exp(new),
    ), replace(check, correlation=round(r[0], 4),
               correlation_new_tool=round(r[1], 4))  # fmt: skip


def _expected(log: Any, cuts: WearWindows, conditions: pd.DataFrame, words: list[str]) -> Any:
    """Logarithm of the RMS of each cut by the cuts of the other tools; NaN where not known."""
    from sklearn.linear_model import HuberRegressor
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    numbers = [name for name in cuts.condition_units
               if not np.array_equal(conditions[name], cuts.progress, equal_nan=True)]  # fmt: skip
    design = conditions[numbers].apply(lambda x: np.log(x) if x.min() > 0 else x)
    design = design.assign(wear=cuts.wear)
    design = design.join(pd.get_dummies(conditions[words], dtype=float)) if words else design
    known, new = design.notna().all(axis=1) & log.notna(), log * np.nan
    if len(np.unique(cuts.tool[known])) >= FEWEST_TOOLS:
        huber = HuberRegressor(alpha=RIDGE * int(known.sum()), max_iter=1000)
        new[known] = cross_val_predict(
            make_pipeline(StandardScaler(), huber), design[known], log[known],
            groups=cuts.tool[known], cv=LeaveOneGroupOut(),
        )  # fmt: skip
    return new


def force_check(
    serving: ServingModel | None, records: Records, sets: GoldenSets | None
) -> ForceCheck | None:
    """Force from the spindle's load in cuts of known engagement against the dynamometer's law.

    The law is K_tc and K_te of the mean forces on the dynamometer, where the load was not recorded;
    it gives the force of the engagement that the logged program had.  None without both.
    """
    power, model = spindle_power(serving), None if serving is None else serving.model
    law = [getattr(model, "mean_force", {}).get(name) for name in ("K_tc", "K_te")]
    K = [one.value for one in law if one is not None and one.value is not None]
    signals, raw = records.signals, records.raw
    if serving is None or power is None or len(K) < 2 or signals is None or raw is None:
        return None
    load, errors = power.records, dict[str, Floats]()
    for log in load_logs(records.files, load, signals, raw):
        output, cut = log.entry.get("output"), log.cut
        if not cut or not output or role_of([log.name], serving.judging.roles, sets) == "sealed":
            continue
        try:
            read = read_log(signals / str(output), load.items, log.name, cuts=True)
            labelled = cut_log(read, program_lines(raw, cut, load.setup), settle_s=load.settle_s,
                               name=log.name, program=cut.program)  # fmt: skip
        except ValueError:
            continue  # identification says why it is left out
        cuts = load_levels(labelled, load.scale, settle_s=load.settle_s)
        cuts = cuts.where((cuts.removal > 0) & (cuts.speed >= load.drive.minimum_speed))
        law_power = K[0] * N_MM2 * cuts.removal + K[1] * N_MM * cuts.edge
        # of the force as of the power: both are over the same cutting speed
        off = np.abs(cuts.power - power.no_load(cuts.speed)[0] - law_power) / law_power
        errors[log.name] = off[np.isfinite(off)]
    joined = np.concatenate([np.zeros(0), *errors.values()])
    return ForceCheck(
        recordings=tuple(errors), levels=len(joined), most_percent=MOST_PERCENT,
        mape_percent=round(100 * float(joined.mean()), 2) if len(joined) else None,
    )  # fmt: skip
