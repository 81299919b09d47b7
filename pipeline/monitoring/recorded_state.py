"""State of the twin over single recordings: trend of vibration, force against the dynamometer.

The vibration of a cut is the RMS of its windows from 10 to 1000 Hz.  Expected at its conditions is
a log-linear regression on them and on the wear, fitted robustly to the other tools,

    ln RMS = c_0 + sum_i c_i ln x_i + c_w VB + words,

at the level of the tool's own earlier cuts of the same kind: how resonances answer a speed that no
other tool has run at, conditions do not say.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.cutting.force.force_law import N_MM, N_MM2
from pipeline.monitoring.day_estimates import spindle_power
from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.store import write_table
from pipeline.schema.twin_state import RECORDINGS, ForceCheck, TrendCheck
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.cases import Records, role_of
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
"""Cuts of a tool from which its level is known; tools from which on a correlation is told."""


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
    lives = serving.one.cases(records, serving.judging, sets) if serving else None
    windows = [case.load() for case in lives.cases if case.role != "sealed"] if lives else []
    every = WearWindows.joined(windows) if windows else None
    if every is None:
        return ()
    channels = [k for k, name in enumerate(every.channels)
                if every.units[k] == "m/s^2" or name.startswith("vibration")]  # fmt: skip
    if not channels:
        return ()
    low, high = BAND_HZ
    if every.rate_Hz < 2 * high or every.rate_Hz / every.values.shape[2] > low * (1 + 1e-9):
        why = (f"windows of {every.values.shape[2]} samples at {every.rate_Hz:g} Hz do not hold "
               f"{low:g} to {high:g} Hz: record faster, or take longer windows")  # fmt: skip
        return tuple(TrendCheck(quantity=every.channels[k], least=LEAST_CORRELATION, reason=why)
                     for k in channels)  # fmt: skip
    _, first, member = np.unique(every.recording, return_index=True, return_inverse=True)
    power = band_rms(every.values[:, channels], every.rate_Hz, BAND_HZ) ** 2
    rms = np.sqrt(pd.DataFrame(power).groupby(member).mean().to_numpy())
    cuts, found, checks = every.of(first), [], []
    for k, measured in zip(channels, rms.T, strict=True):
        table, one = _trend(cuts, measured, every.channels[k])
        found.append(table.assign(unit=every.units[k]))
        checks.append(one)
    units = {"wear": every.wear_unit, **every.condition_units}
    stored = pa.Table.from_pandas(pd.concat(found), preserve_index=False)
    fields = [field.with_metadata({"unit": units.get(field.name, "")}) for field in stored.schema]
    write_table(stored.cast(pa.schema(fields)), out / RECORDINGS)
    return tuple(checks)


def _trend(cuts: WearWindows, rms: Floats, quantity: str) -> tuple[pd.DataFrame, TrendCheck]:
    """Rows of one channel's RMS (N,) beside what is expected, and their correlation."""
    table = pd.DataFrame({
        "recording": cuts.recording, "tool": cuts.tool, "quantity": quantity, "measured": rms,
        "wear": cuts.wear, **cuts.conditions,
    })  # fmt: skip
    silent = rms < SILENT * table.groupby("tool")["measured"].transform("median")
    log = np.log(table["measured"].where(~silent & (table["measured"] > 0)))
    new = _expected(table, log, cuts)
    words = [name for name in cuts.conditions if name not in cuts.condition_units]
    order = np.argsort(cuts.progress, kind="stable")
    off = (log - new).iloc[order].dropna()
    level = off.groupby([table.loc[off.index, name] for name in ("tool", *words)]).transform(
        lambda own: own.expanding(EARLIER).median().shift()
    )
    estimated = new + level.reindex(new.index)
    half = (log - estimated).abs().quantile(0.9)
    both, tools = log.notna() & estimated.notna(), table["tool"][log.notna() & estimated.notna()]
    r = [float(np.exp(log[both]).corr(np.exp(one[both]))) for one in (estimated, new)]
    several = tools.nunique() >= FEWEST_TOOLS and bool(np.isfinite(r).all())
    check = TrendCheck(
        quantity=quantity, recordings=len(tools), tools=tools.nunique(), least=LEAST_CORRELATION,
        correlation=round(r[0], 4) if several else None,
        correlation_new_tool=round(r[1], 4) if several else None,
        reason="" if several else f"fewer than {FEWEST_TOOLS} tools of known wear with "
        f"{EARLIER + 1} cuts of a kind",
    )  # fmt: skip
    return table.assign(
        estimated=np.exp(estimated), low=np.exp(estimated - half), high=np.exp(estimated + half),
        residual=rms - np.exp(estimated), estimated_new_tool=np.exp(new),
    ), check  # fmt: skip


def _expected(table: pd.DataFrame, log: Any, cuts: WearWindows) -> Any:
    """Logarithm of the RMS of each cut by the cuts of the other tools; NaN where not known."""
    from sklearn.linear_model import HuberRegressor

    numbers = [name for name in cuts.condition_units
               if not np.array_equal(table[name], cuts.progress, equal_nan=True)]  # fmt: skip
    words = [name for name in cuts.conditions if name not in cuts.condition_units]
    logs = {name: np.log(table[name].where(table[name] > 0)) for name in numbers}
    dummies = pd.get_dummies(table[words], dtype=float) if words else table[[]]
    design = dummies.assign(**logs, wear=table["wear"])
    design = design.loc[:, design.std() > 1e-9]
    design = (design - design.mean()) / design.std()
    known, new = design.notna().all(axis=1) & log.notna(), log * np.nan
    for tool in table["tool"].unique():
        others, own = known & (table["tool"] != tool), known & (table["tool"] == tool)
        if own.any() and table["tool"][others].nunique() > 1:
            model = HuberRegressor(alpha=RIDGE * int(others.sum()), max_iter=1000)
            new[own] = model.fit(design[others], log[others]).predict(design[own])
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
    load, errors, used = power.records, [np.zeros(0)], []
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
        levels = load_levels(labelled, load.scale, settle_s=load.settle_s)
        cuts = levels.where((levels.removal > 0) & (levels.speed >= load.drive.minimum_speed))
        said = K[0] * N_MM2 * cuts.removal + K[1] * N_MM * cuts.edge
        # of the force as of the power: both are over the same cutting speed
        off = np.abs(cuts.power - power.no_load(cuts.speed)[0] - said) / said
        errors.append(off[np.isfinite(off)])
        used.append(log.name)
    joined = np.concatenate(errors)
    return ForceCheck(
        recordings=tuple(used), levels=len(joined), most_percent=MOST_PERCENT,
        mape_percent=round(100 * float(joined.mean()), 2) if len(joined) else None,
    )  # fmt: skip
