"""Faults of recorders that a table shows by itself: jumps, held values, channels that end early."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.schema.arrays import Floats
from pipeline.signals.columns import unit_of

LENGTH = "MILLIMETER"
FASTEST = 1e4
"""Speed that no axis, slide or growth reaches [mm/s]: linear motors end at half of it."""
UNUSUAL = 20.0
"""Least size of a jump over the largest of 99 % of the steps [1]: noise at high rates is none."""
ASIDE = 3
"""Rows beside a stretch that are left out too [1], so that no straight line bridges a jump."""
SHARE = 0.1
"""Least share of the rows that a value is held for, or a channel is missing at the end [1]."""
FEWEST = 60
"""Least number of rows of a channel that is looked at [1]."""
MOVING = 0.9
"""Least share of rows in which a channel changes that may be found held [1]."""
COMMAND = re.compile(r"command|target|setpoint|(^|_)(ref|reference|plan)(_|$)", re.IGNORECASE)
"""Names of channels that may stand and step: commands."""
OFTEN = 6
"""Jumps from which they are in the nature of a channel, such as a distance to go [1]."""
MOST = 100
"""Faults of one recording that are kept [1]."""


@dataclass(frozen=True, kw_only=True)
class RecorderFault:
    """A fault of a channel in rows ``first`` to before ``after``, not read where ``certain``."""

    channel: str
    first: int
    after: int
    said: str
    certain: bool = False


def recorder_faults(table: pa.Table) -> list[RecorderFault]:
    """Faults of the channels of numbers of a table whose first column is its time."""
    clock = table.column(0)
    whole = pa.types.is_timestamp(clock.type)
    time = np.asarray(clock.cast(pa.int64() if whole else pa.float64()), float)
    time = (time - time[0]) * (1e-9 if whole else 1.0) if len(time) else time
    found: list[RecorderFault] = []
    for field in table.schema:
        if len(time) < FEWEST or not pa.types.is_floating(field.type) or field.name == "t":
            continue
        values = table.column(field.name).to_numpy()
        at = np.flatnonzero(np.isfinite(values))
        if len(at) < FEWEST:
            continue
        asked = COMMAND.search(field.name)
        if not asked and unit_of(field) == LENGTH:
            found += _jumps(field.name, time, values, at)
        held = [] if asked else _held(field.name, time, values, at)
        found += held or _ending(field.name, time, at)
    return found[:MOST]


def _jumps(name: str, time: Floats, values: Floats, at: Any) -> list[RecorderFault]:
    """Stretches between jumps whose level is not that of the longest: its zero is another one."""
    step, lasted = np.diff(values[at]), np.diff(time[at])
    fast = (np.abs(step) > FASTEST * np.maximum(lasted, 0.0)) & (lasted > 0)
    jumps = np.flatnonzero(fast & (np.abs(step) > UNUSUAL * np.quantile(np.abs(step), 0.99)))
    if not 0 < len(jumps) < OFTEN:
        return []
    edges = np.r_[0, jumps + 1, len(at)]
    level = np.r_[0.0, np.cumsum(step[jumps])]
    away = np.abs(level - level[np.argmax(np.diff(edges))]) > 0.5 * np.abs(step[jumps]).min()
    found = []
    for k in np.flatnonzero(away).tolist():
        jump = int(jumps[max(k - 1, 0)])
        said = (
            f"jumps by {step[jump]:.4g} mm in {1e3 * lasted[jump]:.3g} ms at {time[at[jump]]:.4g} s"
        )
        first, after = int(at[edges[k]]) - ASIDE, int(at[edges[k + 1] - 1]) + 1 + ASIDE
        found.append(
            RecorderFault(channel=name, first=max(first, 0), after=after, said=said, certain=True)
        )
    return found


def _held(name: str, time: Floats, values: Floats, at: Any) -> list[RecorderFault]:
    moves = np.diff(values[at]) != 0
    last = int(np.flatnonzero(moves)[-1]) + 1 if moves.any() else 0
    if len(at) - last < max(SHARE * len(at), FEWEST) or not last or moves[:last].mean() < MOVING:
        return []
    said = f"holds {values[at[last]]:.6g} from {time[at[last]]:.4g} s to the end"
    return [RecorderFault(channel=name, first=int(at[last]), after=len(values), said=said)]


def _ending(name: str, time: Floats, at: Any) -> list[RecorderFault]:
    last, apart = int(at[-1]), int(np.max(np.diff(at)))
    if len(time) - last < max(SHARE * len(time), 2 * apart):
        return []
    said = f"ends at {time[last]:.4g} s, the recording goes on to {time[-1]:.4g} s"
    return [RecorderFault(channel=name, first=last + 1, after=len(time), said=said)]


def without_faults(table: pa.Table, faults: tuple[RecorderFault, ...]) -> pa.Table:
    """The table with nothing where a channel is certainly faulty."""
    for one in faults:
        if one.certain and one.channel in table.column_names:
            place = table.column_names.index(one.channel)
            values = np.array(table.column(place).to_numpy(), float)
            values[one.first : one.after] = np.nan
            table = table.set_column(place, table.schema.field(place), pa.array(values))
    return table
