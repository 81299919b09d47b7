"""The thermocouple logger beside the machine: CSV files of its own layout, clock and faults."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.shop.ledger import Ledger, stamp
from pipeline.shop.parameters import DAY, ShopParameters

GRID = 10  # s between the kept temperatures of the network
RESOLUTION = 0.1  # K
OPEN = 1372.0  # degC, what a type K channel shows when its junction opens for a moment

# channel: shares of front bearing, rear bearing, housing, bed, coolant and air that its tip feels
CHANNELS: dict[str, tuple[float, ...]] = {
    "Spindle front bearing": (0.85, 0.0, 0.12, 0.0, 0.0, 0.03),
    "Spindle rear bearing": (0.0, 0.85, 0.12, 0.0, 0.0, 0.03),
    "Motor housing": (0.0, 0.0, 0.93, 0.0, 0.0, 0.07),
    "Ambient": (0.0, 0.0, 0.01, 0.01, 0.0, 0.98),
    "Coolant": (0.0, 0.0, 0.0, 0.0, 0.98, 0.02),
    "Bed": (0.0, 0.0, 0.0, 0.97, 0.0, 0.03),
}


@dataclass(kw_only=True)
class Recorder:
    """Keeps what the tips of the thermocouples feel, each 10 s, shape (T, 6)."""

    felt: list[np.ndarray]

    def keep(self, temperatures: np.ndarray, ambient: np.ndarray) -> None:
        """Add one day: ``temperatures`` (86400, 10) of the nodes and the air (86400,) [degC]."""
        from pipeline.shop.network import BED, COOLANT, FRONT, HOUSING, REAR

        nodes = temperatures[::GRID][:, [FRONT, REAR, HOUSING, BED, COOLANT]]
        sources = np.column_stack([nodes, ambient[::GRID]])
        self.felt.append(sources @ np.array(list(CHANNELS.values())).T)


def write_thermocouples(
    folder: Path, felt: np.ndarray, parameters: ShopParameters, ledger: Ledger
) -> None:
    """Write one file for each day of the logger's clock; faults and clock go into the ledger."""
    p, random = parameters.logger, parameters.generator("logger")
    shown = np.arange(0, parameters.days * DAY, p.interval, dtype=float)  # of the logger's clock
    zone = 3600.0 * p.zone_hours
    true = (shown - zone - p.clock_offset) / (1 + p.clock_drift / DAY)
    inside = (true >= 0) & (true <= (felt.shape[0] - 1) * GRID)
    shown, true = shown[inside], true[inside]
    grid = np.arange(felt.shape[0]) * GRID
    offsets = random.normal(0, p.offset, felt.shape[1])
    read = np.column_stack([np.interp(true, grid, felt[:, j]) for j in range(felt.shape[1])])
    read += offsets + random.normal(0, p.noise, read.shape)
    read = np.round(read / RESOLUTION) * RESOLUTION
    dropouts, spikes = _faults(read, true, parameters, random)
    folder.mkdir(parents=True, exist_ok=True)
    for day in range(parameters.days):
        rows = (shown >= day * DAY) & (shown < (day + 1) * DAY)
        name = f"{stamp(parameters.start, day * DAY)[:10]}.csv"
        text = _text(shown[rows], read[rows], parameters)
        (folder / name).write_text(text, encoding=p.encoding, newline="\n")
    ledger.thermocouples = {
        "channels": list(CHANNELS), "rows": int(shown.size), "dropouts": dropouts,
        "blank_cells": int(np.isnan(read).sum()), "spikes": spikes,
        "clock": {"offset_s": p.clock_offset, "drift_s_per_day": p.clock_drift,
                  "zone_hours": p.zone_hours, "shown": "UTC * (1 + drift/86400) + offset + zone"},
        "channel_offsets_K": dict(zip(CHANNELS, np.round(offsets, 4).tolist(), strict=True)),
    }  # fmt: skip


def _faults(
    read: np.ndarray, true: np.ndarray, parameters: ShopParameters, random: np.random.Generator
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Blank stretches of a channel and put spikes into ``read`` (T, 6); what was done [UTC]."""
    p, names, start = parameters.logger, list(CHANNELS), parameters.start
    dropouts: list[dict[str, object]] = []
    for a in np.sort(random.integers(0, true.size, p.dropouts)):
        channel = int(random.integers(len(names)))
        b = min(a + int(random.uniform(600, 4 * 3600) / p.interval), true.size) - 1
        read[a : b + 1, channel] = np.nan
        dropouts.append({"channel": names[channel], "start": stamp(start, true[a]),
                         "end": stamp(start, true[b])})  # fmt: skip
    spikes: list[dict[str, object]] = []
    for a in np.unique(random.integers(0, true.size, p.spikes)):
        channel = int(random.integers(len(names)))
        if not np.isnan(read[a, channel]):
            read[a, channel] = OPEN
            spikes.append({"channel": names[channel], "time": stamp(start, true[a]), "value": OPEN})
    return dropouts, spikes


def _text(shown: np.ndarray, read: np.ndarray, parameters: ShopParameters) -> str:
    """One file: a block about the logger, names, units, rows; an empty cell for no value."""
    p = parameters.logger
    comma = p.decimal == ","
    separator, unit = (";", "°C") if p.encoding == "cp1252" or comma else (",", "degC")
    moments = parameters.start + np.round(shown).astype("timedelta64[s]")
    first = str(moments[0]).replace("T", " ")
    head = [
        "Thermocouple logger TL-8 (simulated)",
        f"Machine{separator}{parameters.machine}",
        f"Serial number{separator}TL8-{parameters.seed:05d}",
        f"Start{separator}{first}",
        f"Interval{separator}{p.interval} s",
        "",
        separator.join(["Time", *CHANNELS]),
        separator.join(["", *[unit] * len(CHANNELS)]),
    ]
    tenths = np.nan_to_num(np.round(read / RESOLUTION), nan=np.iinfo(np.int32).min).astype(int)
    words = {k: f"{k * RESOLUTION:.1f}".replace(".", p.decimal) for k in np.unique(tenths).tolist()}
    words[np.iinfo(np.int32).min] = ""
    times = [m.replace("T", " ") for m in np.datetime_as_string(moments, unit="s").tolist()]
    rows = [
        separator.join([time, *(words[k] for k in row)])
        for time, row in zip(times, tenths.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows]) + "\n"
