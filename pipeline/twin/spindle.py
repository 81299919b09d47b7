"""The spindle's inputs from the state table, and one spindle's temperature over a stretch."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.signals.columns import column
from pipeline.signals.windows import StateSegment, state_segments
from pipeline.thermal.network import SOURCES, SpindleThermalParameters, heat_sources, temperatures

TARGET = "spindle_temperature"
"""The column that is modelled [CELSIUS]."""


@dataclass(frozen=True, kw_only=True)
class SpindleRecords:
    """Signals that a machine records of its spindle.

    Parameters
    ----------
    position_control : bool
        Whether the spindle also works as a C axis, its state in ``spindle_position_control``.
    ambient : bool
        Whether ``ambient_temperature`` is recorded; otherwise one constant is identified.
    extra : tuple of str
        Further columns of the state table that a forest may look at.
    """

    position_control: bool = False
    ambient: bool = False
    extra: tuple[str, ...] = ()

    @property
    def sources(self) -> list[str]:
        """Heat sources that this machine's records can excite."""
        return [s for s in SOURCES if s != "position_hold" or self.position_control]

    @property
    def signals(self) -> list[str]:
        """Columns of the state table that the model needs to be served."""
        names = ["spindle_speed", "spindle_load"]
        if self.position_control:
            names.append("spindle_position_control")
        if self.ambient:
            names.append("ambient_temperature")
        return names


def with_heat(state: pd.DataFrame, records: SpindleRecords) -> pd.DataFrame:
    """``state`` with one column a heat source, at the state's own sampling.

    The sources are taken before averaging: the mean of n^(5/3) is not the mean of n to the 5/3.

    Raises
    ------
    ValueError
        When a needed column is missing; the message names it.
    """
    missing = [name for name in records.signals if name not in state.columns]
    if missing:
        raise ValueError(
            f"the state table has no column {missing[0]}; "
            "map it to a data item in conf/machine/, or say in its spindle section that it is "
            "not recorded"
        )

    def si(name: str) -> Floats:
        c = column(name)
        return state[name].to_numpy(float) * c.factor + c.offset

    hold = (
        state["spindle_position_control"].to_numpy(float)
        if records.position_control
        else np.zeros(len(state))
    )
    heat = heat_sources(si("spindle_speed"), si("spindle_load"), hold)
    return state.assign(**{name: heat[:, i] for i, name in enumerate(SOURCES)})


def spindle_stretches(
    state: pd.DataFrame,
    day: str,
    records: SpindleRecords,
    *,
    step: float,
    bridge_s: float,
    shortest_s: float,
) -> Iterator[StateSegment]:
    """The stretches of one day's state table, ready for the network."""
    inputs = [*SOURCES, *(["ambient_temperature"] if records.ambient else [])]
    yield from state_segments(
        with_heat(state, records),
        day,
        inputs=inputs,
        target=TARGET,
        step=step,
        bridge_s=bridge_s,
        shortest_s=shortest_s,
    )


def stretch_of(
    state: pd.DataFrame, start_temperature: float, records: SpindleRecords, *, step: float
) -> StateSegment:
    """A whole state table as one stretch that starts from a given temperature.

    Unknown inputs are held from before however long; the temperature of the spindle in ``state``
    is not looked at.

    Raises
    ------
    ValueError
        When the table is empty, a column is missing, an input is unknown in the first step, or the
        temperature to start from is not a number.
    """
    if state.empty:
        raise ValueError("the state table has no row: give the time that is to be predicted")
    if not np.isfinite(start_temperature):
        raise ValueError(f"start temperature {start_temperature} degC is no number: measure it")
    given = state.assign(**{TARGET: float(start_temperature)})
    inputs = [*SOURCES, *(["ambient_temperature"] if records.ambient else [])]
    found = list(
        state_segments(
            with_heat(given, records),
            str(state.index[0].date()),
            inputs=inputs,
            target=TARGET,
            step=step,
            bridge_s=np.inf,
            shortest_s=0.0,
        )
    )
    if not found:
        raise ValueError(
            f"no row of the state table knows all of {', '.join(records.signals)}: "
            "nothing can be predicted without them"
        )
    frame = found[0].frame
    if frame.index[0] > state.index[0]:
        raise ValueError(
            f"{', '.join(records.signals)} are not all known before {frame.index[0]}, the start "
            f"temperature is of {state.index[0]}: start where they are known"
        )
    return found[0]


def heat_of(frame: pd.DataFrame) -> Floats:
    """Heat sources of a stretch's frame, shape (T, len(SOURCES))."""
    return frame[list(SOURCES)].to_numpy(float)


def ambient_of(frame: pd.DataFrame, records: SpindleRecords) -> Floats | None:
    """Measured ambient of a stretch's frame [degC], shape (T,), None when it is not recorded."""
    return frame["ambient_temperature"].to_numpy(float) if records.ambient else None


def free_run(
    stretch: StateSegment, records: SpindleRecords, parameters: SpindleThermalParameters
) -> Floats:
    """Node temperatures over a stretch from its first measured temperature only, (nodes, T)."""
    frame = stretch.frame
    return temperatures(
        heat_of(frame),
        frame[TARGET].iloc[0],
        parameters,
        stretch.step,
        ambient=ambient_of(frame, records),
    )


def from_measured(
    stretch: StateSegment,
    start: int,
    length: int,
    records: SpindleRecords,
    parameters: SpindleThermalParameters,
    body: Floats | None,
) -> Floats:
    """Temperature over ``length`` steps from the temperature measured at step ``start``, (length,).

    ``body`` is the unmeasured node's temperature of a free run from the stretch's beginning, shape
    (T,): its start is what was known by then.
    """
    frame = stretch.frame.iloc[start : start + length]
    return temperatures(
        heat_of(frame),
        frame[TARGET].iloc[0],
        parameters,
        stretch.step,
        ambient=ambient_of(frame, records),
        body_start=None if body is None else body[start],
    )[0]
