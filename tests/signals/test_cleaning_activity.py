import numpy as np
import pandas as pd
import pytest
from cleaning_records import NS, series
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.signals.cleaning.activity import cycles, intervals, seconds_in_states, segments
from pipeline.signals.cleaning.settings import CleanSettings

SETTINGS = CleanSettings()
AUTOMATIC = [(0, "AUTOMATIC")]


def made(execution, end=10_000, mode=AUTOMATIC, **more):
    reported = {"execution": series(execution), "controller_mode": series(mode)}
    reported |= {name: series(points) for name, points in more.items()}
    return cycles(intervals(reported, end * NS), SETTINGS)


def test_feed_hold_and_interruption_do_not_end_a_cycle():
    found = made(
        [(0, "READY"), (10, "ACTIVE"), (30, "FEED_HOLD"), (35, "ACTIVE"), (50, "INTERRUPTED"),
         (60, "ACTIVE"), (100, "READY")],
        program=[(0, "O7")], tool_number=[(0, "1"), (20, "2"), (70, "3")],
    )  # fmt: skip
    (row,) = found.to_dict("records")
    assert (row["active_s"], row["feed_hold_s"], row["interrupted_s"]) == (75, 5, 10)
    assert (row["program"], row["tool_changes"], row["complete"]) == ("O7", 2, True)
    assert (row["end"] - row["start"]).total_seconds() == 90


@pytest.mark.parametrize(
    ("execution", "mode"),
    [
        ([(0, "ACTIVE"), (50, "STOPPED")], AUTOMATIC),
        ([(0, "ACTIVE"), (40, "FEED_HOLD"), (50, "READY")], AUTOMATIC),
        ([(0, "ACTIVE"), (50, "READY")], [(0, "AUTOMATIC"), (50, "MANUAL")]),
        ([(0, "ACTIVE"), (50, None)], AUTOMATIC),
    ],
    ids=["stopped", "reset out of a hold", "mode taken away", "lost for good"],
)
def test_a_cycle_that_did_not_run_to_its_end_is_not_complete(execution, mode):
    (row,) = made(execution, mode=mode).to_dict("records")
    assert not row["complete"]
    assert row["active_s"] in (40, 50)


def test_a_run_in_manual_data_input_is_no_cycle():
    assert made([(0, "ACTIVE"), (9, "READY")], mode=[(0, "MANUAL_DATA_INPUT")]).empty


def test_a_short_loss_is_bridged_when_the_same_program_goes_on():
    lost = [(0, "ACTIVE"), (50, None), (110, "ACTIVE"), (200, "READY")]
    (row,) = made(lost, program=[(0, "O1"), (50, None), (110, "O1")]).to_dict("records")
    assert (row["active_s"], row["complete"]) == (140, True)
    other = made(lost, program=[(0, "O1"), (50, None), (110, "O2")])
    assert other["program"].tolist() == ["O1", "O2"]
    assert other["complete"].tolist() == [False, True]


def test_a_long_loss_ends_a_cycle():
    found = made([(0, "ACTIVE"), (50, None), (5000, "ACTIVE"), (5100, "READY")])
    assert found["active_s"].tolist() == [50, 100]


states = st.sampled_from(["ACTIVE", "READY", "FEED_HOLD", "INTERRUPTED", "STOPPED", "WAIT", None])


@given(st.lists(st.tuples(st.integers(1, 2000), states), min_size=1, max_size=40))
@settings(deadline=None, max_examples=30)
def test_time_is_conserved(drawn):
    time = np.cumsum([dt for dt, _ in drawn])
    points = [(float(t), w) for t, (_, w) in zip(time, drawn, strict=True)]
    if not any(w for _, w in points):
        points[0] = (points[0][0], "READY")
    end = int(time[-1]) + 5
    found = intervals({"execution": series(points)}, end * NS)
    spent = seconds_in_states(found)
    assert sum(spent.values()) == pytest.approx(end - time[0])
    table = cycles(found, SETTINGS)
    times = ["active_s", "feed_hold_s", "interrupted_s", "idle_s"]
    span = (table["end"] - table["start"]).dt.total_seconds()
    assert (table[times].sum(axis=1) <= span + 1e-6).all()
    assert table["active_s"].sum() == pytest.approx(spent.get("ACTIVE", 0))
    assert (table["start"].to_numpy()[1:] >= table["end"].to_numpy()[:-1]).all()


def state(n, **columns):
    time = pd.date_range("2024-03-04T06:00:00Z", periods=n, freq="s").astype("datetime64[ns, UTC]")
    return pd.DataFrame({"time": time, **columns})


def kinds(found):
    seconds = (found["end"] - found["start"]).dt.total_seconds()
    return list(zip(found["kind"], seconds, strict=True))


def milling(n=1000):
    """Idle, warm-up, a program that cuts from 600 to 800, idle."""
    t = np.arange(n)
    turning = ((t >= 100) & (t < 400)) | ((t >= 500) & (t < 900))
    cut = (t >= 600) & (t < 800)
    return state(
        n,
        execution=np.where((t >= 500) & (t < 900), "ACTIVE", "READY"),
        program="O1",
        spindle_speed=np.where(turning, 6000.0, 0.0),
        spindle_load=np.where(cut, 20.0, np.where(turning, 3.0 + (t % 2), 0.0)),
        path_feedrate=np.where((t >= 500) & (t < 900), 20.0, 0.0),
    )


def test_segments_tell_warm_up_air_and_cut():
    assert kinds(segments(milling(), SETTINGS)) == [
        ("idle", 100), ("warm_up", 300), ("idle", 100), ("air", 100), ("cut", 200),
        ("air", 100), ("idle", 100),
    ]  # fmt: skip


def test_the_load_of_an_accelerating_spindle_is_no_cut():
    t = np.arange(600)
    load = np.where(t < 300, 0.0, 2.0)
    load[300] = 90.0
    table = state(
        600, execution="ACTIVE", spindle_speed=np.where(t < 300, 0.0, 3000.0), spindle_load=load,
        path_feedrate=10.0,
    )  # fmt: skip
    assert "cut" not in set(segments(table, SETTINGS)["kind"])


def test_off_stands_between_stretches_and_unknown_seconds_are_in_no_segment():
    table = milling()
    later = table.assign(time=table["time"] + pd.Timedelta(hours=10))
    later.loc[:49, "execution"] = None
    found = segments(pd.concat([table, later], ignore_index=True), SETTINGS)
    off = found[found["kind"] == "off"]
    assert kinds(off) == [("off", 36_000 - 1000)]
    seconds = (found["end"] - found["start"]).dt.total_seconds().sum()
    assert seconds == 36_000 + 1000 - 50


def test_a_program_named_for_it_is_a_warm_up():
    found = segments(milling(), SETTINGS, warm_up_programs=("O1",))
    assert ("warm_up", 400) in kinds(found)


def test_a_warm_up_ends_where_another_program_begins():
    """The second program only cuts at its speed, so that its load passes for no load there."""
    t = np.arange(1500)
    warm, hidden, last = (t >= 100) & (t < 400), (t >= 450) & (t < 1000), (t >= 1100) & (t < 1400)
    running = warm | hidden | last
    table = state(
        1500, execution=np.where(running, "ACTIVE", "READY"),
        program=np.where(t < 102, "O7", np.where(t < 440, "O9001", "O2040")),
        spindle_speed=np.select([warm, hidden, last], [6000.0, 1250.0, 3000.0], 0.0),
        spindle_load=np.select([t >= 1300, hidden, running], [30.0, 80.0, 2.0], 0.0),
        path_feedrate=np.where(hidden | last, 8.0, 0.0),
    )  # fmt: skip
    assert kinds(segments(table, SETTINGS)) == [
        ("idle", 100), ("warm_up", 300), ("idle", 50), ("air", 550), ("idle", 100), ("air", 200),
        ("cut", 100), ("idle", 100),
    ]  # fmt: skip
    again = segments(table.assign(program="O9001"), SETTINGS)
    assert kinds(again)[3] == ("warm_up", 550)
