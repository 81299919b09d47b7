"""State of the twin over single recordings: trend of vibration, force against the dynamometer.

The vibration of a cut is the RMS of its windows from 10 to 1000 Hz.  Expected at its conditions is
a log-linear regression on them and on the wear, fitted robustly to the other tools,

    ln RMS = c_0 + sum_i c_i ln x_i + c_w VB + words,

at the level of the tool's own earlier cuts of the same kind: how resonances answer a speed that no
other tool has run at, conditions do not say.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pipeline.cutting.force.force_law import N_MM, N_MM2
from pipeline.monitoring.day_estimates import spindle_power
from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.schema.twin_state import RECORDINGS, ForceCheck, TrendCheck, write_recordings
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.cases import Records, role_of
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands
from pipeline.submodels.cutting.spindle_load.identify import load_logs
from pipeline.submodels.cutting.spindle_load.levels import load_levels
from pipeline.submodels.cutting.spindle_load.readings import cut_log, program_lines, read_log

VIBRATIONS = ("m/s^2", "m/s")
"""Units of channels that hold a vibration."""
RIDGE = 1e-2
"""Penalty of the regression on standardised conditions, a share of the recordings [1]: conditions
that always change together share their effect."""
HUBER, REWEIGHTED = 1.345, 20
"""Huber's constant, for 95 % efficiency with normal errors [1], and his reweightings."""
SILENT = 0.05
"""Share of a tool's usual RMS below which a sensor shows nothing of a cut [1]."""
EARLIER = 2
"""Cuts of a tool from which its level is known."""
FEWEST_TOOLS = 3
"""Least number of tools for a correlation over tools left out."""


@dataclass(frozen=True, kw_only=True)
class TwinStateSettings(Ranged, section="twin_state"):
    """State of the twin over production records, and what it is held against."""

    tool_tables: tuple[str, ...] = ()
    """Tables of ``conf/tool/`` with the tools that the machine's log names; of two tables with the
    same number the later one counts."""
    band_Hz: tuple[Positive, ...] = (10.0, 1000.0)
    """Band of the vibration's RMS [Hz]."""
    correlation: Annotated[float, Range(least=0.0, most=1.0)] = 0.85
    """Correlation of measured and expected vibration that is asked for [1] (Twin2026)."""
    force_mape_percent: Positive = 20.0
    """Allowed mean absolute error of the force from the load against the dynamometer's [%]
    (Twin2026)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.band_Hz) != 2 or self.band_Hz[0] >= self.band_Hz[1]:
            raise ValueError(
                f"twin_state.band_Hz = {list(self.band_Hz)} must be the lowest and the highest "
                "frequency"
            )


def band_rms(values: Any, rate_Hz: float, band_Hz: tuple[float, float]) -> Floats:
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
    serving: ServingModel | None, records: Records, sets: GoldenSets | None,
    settings: TwinStateSettings, out: Path,
) -> tuple[TrendCheck, ...]:  # fmt: skip
    """Vibration of each recorded cut beside what is expected of it; writes ``recordings.parquet``.

    ``serving``: the champion's wear model, whose settings name the recordings; none without.
    Sealed tools are not looked at.
    """
    (out / RECORDINGS).unlink(missing_ok=True)
    if serving is None or records.signals is None:
        return ()
    lives = serving.one.cases(records, serving.judging, sets)
    open_ones = lives.of("training", "held_out", "golden")
    if not open_ones:
        return ()
    windows = WearWindows.joined([one.load() for one in open_ones])
    channels = [k for k, unit in enumerate(windows.units) if unit in VIBRATIONS]
    band = (settings.band_Hz[0], settings.band_Hz[1])
    if not channels:
        return ()
    resolved = windows.rate_Hz / windows.values.shape[2]
    if windows.rate_Hz < 2 * band[1] or resolved > band[0] * (1 + 1e-9):
        reason = (
            f"windows of {windows.values.shape[2]} samples at {windows.rate_Hz:g} Hz do not hold "
            f"{band[0]:g} to {band[1]:g} Hz: record faster, or take longer windows"
        )
        return tuple(_check(windows, k, settings, reason=reason) for k in channels)
    names, first, member = np.unique(windows.recording, return_index=True, return_inverse=True)
    power = band_rms(windows.values[:, channels], windows.rate_Hz, band) ** 2
    cuts = windows.of(first)
    count = np.bincount(member)
    rows: dict[str, list[Any]] = {}
    checks = []
    design, conditions = _design(cuts)
    kinds = [cuts.conditions[n] for n in cuts.conditions if n not in cuts.condition_units]
    kind = np.array(["|".join(map(str, one)) for one in zip(cuts.tool, *kinds, strict=True)])
    for place, k in enumerate(channels):
        rms = np.sqrt(np.bincount(member, power[:, place]) / count)
        usual = np.array([np.median(rms[cuts.tool == one]) for one in cuts.tool])
        log = np.log(np.where(rms > SILENT * usual, rms, np.nan))  # a dead sensor shows no cut
        new = _expected(np.exp(log), design, cuts.tool)
        following = _followed(log, new, kind, cuts.progress)
        half = _half_width(log - following, cuts.tool)
        checks.append(_check(windows, k, settings, conditions, cuts.tool, log, (new, following)))
        columns = {
            "recording": names, "tool": cuts.tool, "quantity": [windows.channels[k]] * len(names),
            "unit": [windows.units[k]] * len(names), "measured": rms,
            "estimated": np.exp(following), "low": np.exp(following - half),
            "high": np.exp(following + half), "residual": rms - np.exp(following),
            "estimated_new_tool": np.exp(new), "wear": cuts.wear,
            **{name: cuts.conditions[name] for name in cuts.condition_units},
        }  # fmt: skip
        for name, one in columns.items():
            rows.setdefault(name, []).extend(np.asarray(one).tolist())
    words = {name: rows.pop(name) for name in ("recording", "tool", "quantity", "unit")}
    numbers = {name: np.array(one, dtype=float) for name, one in rows.items()}
    units = {"wear": cuts.wear_unit, **cuts.condition_units}
    write_recordings(words, numbers, units, out / RECORDINGS)
    return tuple(checks)


def _check(
    windows: WearWindows, channel: int, settings: TwinStateSettings,
    conditions: tuple[str, ...] = (), tool: Any = (), log: Any = (), estimates: Any = (),
    *, reason: str = "",
) -> TrendCheck:  # fmt: skip
    """Correlation of a channel's measured RMS with its estimates; their logarithms, (N,) each."""
    correlations: list[float | None] = []
    tools, recordings = 0, 0
    for one in estimates:
        both = np.isfinite(one) & np.isfinite(log)
        tools, recordings = len(np.unique(tool[both])), int(both.sum())
        several = tools >= FEWEST_TOOLS
        r = np.corrcoef(np.exp(log[both]), np.exp(one[both]))[0, 1] if several else None
        correlations.append(None if r is None or not np.isfinite(r) else round(float(r), 4))
    if not reason and None in correlations:
        reason = f"fewer than {FEWEST_TOOLS} tools of known wear with {EARLIER + 1} cuts of a kind"
    new, following = correlations or (None, None)
    return TrendCheck(
        quantity=windows.channels[channel], unit=windows.units[channel], recordings=recordings,
        band_Hz=(settings.band_Hz[0], settings.band_Hz[1]), tools=tools, correlation=following,
        correlation_new_tool=new, least=settings.correlation, conditions=conditions, reason=reason,
    )  # fmt: skip


def _design(cuts: WearWindows) -> tuple[Floats, tuple[str, ...]]:
    """Standardised conditions of cuts that differ between them, (N, D), and their names.

    NaN where one is not known.  Use of the tool is none: its wear stands for it.
    """
    columns: dict[str, Floats] = {}
    for name, value in cuts.conditions.items():
        if name in cuts.condition_units:
            number = np.asarray(value, dtype=float)
            with np.errstate(divide="ignore", invalid="ignore"):
                logs = np.log(np.where(number > 0, number, np.nan))
            if not np.array_equal(number, cuts.progress, equal_nan=True):
                columns[name] = logs
        else:
            for word in sorted(set(value.tolist()))[1:]:
                columns[f"{name} {word}"] = (value == word).astype(float)
    columns["wear"] = cuts.wear
    varied = {n: v for n, v in columns.items() if np.isfinite(v).any() and np.nanstd(v) > 1e-9}
    if not varied:
        return np.zeros((len(cuts), 0)), ()
    design = np.column_stack(list(varied.values()))
    return (design - np.nanmean(design, axis=0)) / np.nanstd(design, axis=0), tuple(varied)


def _expected(rms: Floats, design: Floats, tool: Any) -> Floats:
    """Logarithm of the RMS of each cut that the cuts of the other tools say, (N,)."""
    with np.errstate(divide="ignore"):
        log = np.log(rms)
    known = np.isfinite(design).all(axis=1) & np.isfinite(log)
    expected = np.full(len(rms), np.nan)
    for one in np.unique(tool):
        others, own = known & (tool != one), known & (tool == one)
        if len(np.unique(tool[others])) > 1:
            level, slope = _robust(design[others], log[others])
            expected[own] = level + design[own] @ slope
    return expected


def _robust(x: Floats, y: Floats) -> tuple[float, Floats]:
    """Level and slopes (D,) of y (N,) on x (N, D) by Huber's weights: cuts with a fault are few."""
    weight = np.ones(len(y))
    for _ in range(REWEIGHTED):
        centre, level = weight @ x / weight.sum(), float(weight @ y / weight.sum())
        apart = x - centre
        gram = (apart.T * weight) @ apart + RIDGE * len(y) * np.eye(x.shape[1])
        slope = np.linalg.solve(gram, (apart.T * weight) @ (y - level))
        left = np.abs(y - level - apart @ slope)
        weight = np.minimum(1.0, HUBER * np.median(left) / 0.6745 / np.maximum(left, 1e-12))
    return level - float(centre @ slope), slope


def _followed(log: Floats, expected: Floats, kind: Any, progress: Floats) -> Floats:
    """Expected logarithms (N,) at the level of the earlier cuts of the same tool and kind."""
    found = np.full(len(log), np.nan)
    for one in np.unique(kind):
        rows = np.flatnonzero((kind == one) & np.isfinite(expected) & np.isfinite(log))
        rows = rows[np.argsort(progress[rows], kind="stable")]
        for k in range(EARLIER, len(rows)):
            before = rows[:k]
            found[rows[k]] = expected[rows[k]] + np.median((log - expected)[before])
    return found


def _half_width(error: Floats, tool: Any) -> float:
    """Half of the 90 % interval of errors (N,) of tools; NaN without any."""
    there = np.isfinite(error)
    if not there.any():
        return float("nan")
    count = int(there.sum())
    return bands(Residuals(
        error=error[there], regime=np.full(count, ""), group=tool[there], t=np.arange(float(count)),
    ))[ALL_REGIMES].upper  # fmt: skip


def force_check(
    serving: ServingModel | None, records: Records, sets: GoldenSets | None,
    settings: TwinStateSettings,
) -> ForceCheck | None:  # fmt: skip
    """Force from the spindle's load in cuts of known engagement against the dynamometer's law.

    The law is K_tc and K_te of the mean forces on the dynamometer, where the load was not recorded;
    it gives the force of the engagement that the logged program had.  None without both.
    """
    if serving is None or records.signals is None or records.raw is None:
        return None
    load, power = serving.judging.cutting_records.spindle, spindle_power(serving)
    model: Any = serving.model
    law = [model.mean_force.get(name) for name in ("K_tc", "K_te")]
    known = [one.value for one in law if one is not None and one.value is not None]
    if load is None or power is None or not load.cuts or len(known) < len(law):
        return None
    K_tc, K_te = known[0] * N_MM2, known[1] * N_MM
    errors, used, why = list[Floats](), list[str](), ""
    for log in load_logs(records.files, load, records.signals, records.raw):
        output = log.entry.get("output")
        role = role_of([log.name], serving.judging.roles, sets)
        if log.cut is None or output is None or role == "sealed":
            continue
        try:
            read = read_log(records.signals / str(output), load.items, log.name, cuts=True)
            lines = program_lines(records.raw, log.cut, load.setup)
            labelled = cut_log(read, lines, settle_s=load.settle_s, name=log.name,
                               program=log.cut.program)  # fmt: skip
        except ValueError as error:
            why = str(error)
            continue
        levels = load_levels(labelled, load.scale, settle_s=load.settle_s)
        cuts = levels.where((levels.removal > 0) & (levels.speed >= load.drive.minimum_speed))
        said = K_tc * cuts.removal + K_te * cuts.edge
        # of the force as of the power: both are over the same cutting speed
        off = np.abs(cuts.power - power.no_load(cuts.speed)[0] - said) / said
        errors.append(off[np.isfinite(off)])
        used.append(log.name)
    joined = np.concatenate([np.zeros(0), *errors])
    return ForceCheck(
        recordings=tuple(used), levels=len(joined), most_percent=settings.force_mape_percent,
        mape_percent=round(100 * float(joined.mean()), 2) if len(joined) else None, reason=why,
    )  # fmt: skip
