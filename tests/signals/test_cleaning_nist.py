"""Two working weeks of a real mill-turn; how they were read is not what is tested here."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cleaning_records import table

from pipeline.signals.cleaning.clean import clean
from pipeline.signals.cleaning.settings import CleanMachine, PositionControl
from pipeline.signals.columns import OBSERVATIONS
from pipeline.signals.contracts import check

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = pytest.mark.skipif(
    RECORDINGS is None, reason="KERF_RECORDINGS does not name the folder of real recordings"
)

MACHINE = CleanMachine(
    signals={
        "execution": "execution", "controller_mode": "mode", "program": "program",
        "tool_number": "Tool_number", "emergency_stop": "estop", "power_state": "power",
        "z_position": "Zabs", "z_feedrate": "Zfrt", "x_feedrate": "Xfrt", "c_angle": "Cdeg",
        "spindle_speed": "S2rpm", "spindle_load": "S2load", "spindle_temperature": "S2temp",
        "second_spindle_speed": "Srpm", "second_spindle_load": "Sload",
        "second_spindle_temperature": "Stemp", "path_feedrate": "Fact", "total_time": "total_time",
        "auto_time": "auto_time", "cut_time": "cut_time",
    },
    position_control=PositionControl(angle="Cdeg", speed="S2rpm", rate="Cfrt"),
)  # fmt: skip
WORDS = ("execution", "mode", "program", "Tool_number", "estop", "power")


def observations(path, target):
    """One day's log as observations: what the conditions say is of no use here."""
    lines = [line.split("|") for line in path.read_text(encoding="latin-1").splitlines()]
    words = [rest[0] if len(rest) == 1 else "condition" for _, _, *rest in lines]
    items = [item for _, item, *_ in lines]
    numbers = np.where(np.isin(items, WORDS), np.nan, pd.to_numeric(words, errors="coerce"))
    values = [
        None if word == "UNAVAILABLE" else word if np.isnan(number) else float(number)
        for word, number in zip(words, numbers, strict=True)
    ]
    plain = table([(0, *one) for one in zip(items, values, strict=True)], "1970-01-01")
    moments = pd.to_datetime([moment for moment, *_ in lines], utc=True, format="ISO8601")
    time = pa.array(moments.as_unit("ns").asi8).cast(OBSERVATIONS.field("time").type)
    place = plain.schema.get_field_index("time")
    pq.write_table(plain.set_column(place, OBSERVATIONS.field("time"), time), target)


WEEKS = [
    ("2019-05-20", 2),
    *(pytest.param((day, 7), marks=pytest.mark.proof) for day in ("2017-11-13", "2019-05-20")),
]
"""Monday of a week, and how many of its logs are cleaned."""


@pytest.fixture(scope="module", params=WEEKS)
def week(request, tmp_path_factory):
    monday, logs = request.param
    source = Path(RECORDINGS) / "nist_mazak01" / f"week_{monday}"
    root = tmp_path_factory.mktemp(monday)
    (root / "signals" / "observations").mkdir(parents=True)
    for path in sorted(source.glob("*.txt"))[:logs]:
        observations(path, root / "signals" / "observations" / f"{path.stem}.parquet")
    summary = clean(root / "signals", root / "clean", machine=MACHINE)
    return root, summary


def test_every_zero_of_the_temperatures_is_removed_and_nothing_else(week):
    root, summary = week
    raw = pd.concat(
        [pq.read_table(p).to_pandas() for p in (root / "signals/observations").glob("*.parquet")]
    ).drop_duplicates(["time", "data_item", "number"])
    chosen = raw[raw["data_item"].isin(["S2temp", "Stemp"])]
    assert summary["total"]["removed"]["zero"] == (chosen["number"] == 0).sum()
    assert "jump" not in summary["total"]["removed"]
    assert "counter" not in summary["total"]["removed"]
    state = states(root)
    low = chosen.loc[chosen["number"] > 0].groupby("data_item", observed=True)["number"].min()
    assert state["spindle_temperature"].min() >= low["S2temp"]
    assert state["second_spindle_temperature"].min() >= low["Stemp"]


def states(root):
    paths = sorted((root / "clean" / "state").glob("*.parquet"))
    return pd.concat([pq.read_table(p).to_pandas() for p in paths], ignore_index=True)


def test_cycles_agree_with_the_controllers_own_clock(week):
    root, _ = week
    found = check("cycles", pq.read_table(root / "clean" / "cycles.parquet").to_pandas())
    assert len(found) > 50
    assert (found["active_s"] > 0).all()
    assert (found["end"] > found["start"]).all()
    state = states(root)
    times = ["active_s", "feed_hold_s", "interrupted_s", "idle_s"]
    ran = found[times].sum(axis=1).sum()
    by_clock = state["auto_time"].max() - state["auto_time"].min()
    assert ran == pytest.approx(by_clock, rel=0.15)  # the clock also counts manual data input


def test_time_is_conserved_on_each_day(week):
    root, summary = week
    for day, note in summary["days"].items():
        path = root / "clean" / "state" / f"{day}.parquet"
        if not path.is_file():
            assert note["seconds"] == 0
            continue
        check("state", pq.read_table(path).to_pandas())
        known = sum(s for w, s in note["execution_s"].items() if w != "unknown")
        rows = pq.read_table(path, columns=["execution"])["execution"]
        assert known == pytest.approx(len(rows) - rows.null_count, abs=2 * 60)


def test_segments_fill_the_week_without_overlap(week):
    root, _ = week
    found = check("segments", pq.read_table(root / "clean" / "segments.parquet").to_pandas())
    assert (found["start"].to_numpy()[1:] >= found["end"].to_numpy()[:-1]).all()
    assert {"off", "idle", "air", "cut"} <= set(found["kind"])


def test_a_standing_spindle_heats_only_under_position_control(week):
    """The temperature, which the state is not made from, agrees with it."""
    root, _ = week
    state = states(root)
    half = 300
    time = state["time"].astype("datetime64[ns, UTC]").astype("int64").to_numpy()
    rise = np.full(len(state), np.nan)
    warm = state["spindle_temperature"].to_numpy()
    rise[half:-half] = warm[2 * half :] - warm[: -2 * half]
    whole = np.zeros(len(state), dtype=bool)
    whole[half:-half] = time[2 * half :] - time[: -2 * half] == 2 * half * 1_000_000_000

    def throughout(mask):
        return pd.Series(mask).rolling(2 * half + 1, center=True).min().to_numpy() == 1

    stands = state["spindle_speed"].abs().to_numpy() < 5
    held = state["spindle_position_control"].to_numpy()
    free, engaged = (whole & throughout(stands & (held == v)) for v in (0, 1))
    assert free.sum() > 10_000
    assert engaged.sum() > 10_000
    assert np.nanmean(rise[engaged]) > 0.5 > 0 > np.nanmean(rise[free])
    assert np.nanmean(rise[free] >= 1.5) < 0.02
    assert np.nanmean(rise[engaged] <= -1.5) < 0.05
