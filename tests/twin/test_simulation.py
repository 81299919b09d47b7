"""What a simulated program comes to: sums that agree, a trace that ends with the program."""

import json
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.gcode.moves import METRE_PER_SECOND, Kind
from pipeline.machine.control.parameters import ControlParameters
from pipeline.twin.control import Overrides, planned_program, program_moves
from pipeline.twin.simulation import (
    TYPES,
    block_table,
    blocks,
    limit_words,
    simulate_files,
    summary,
    time_by_cause,
    type_of,
    write_trace,
)
from tests.machine.programs import Writer
from tests.submodels.control.part_programs import SETUP, axis, exciting, moves_of, truth

MILLISECOND = 1e-3
"""Times are rounded to it: each term of a sum is off by half of it."""


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return planned_program(moves_of(exciting(), tmp_path_factory.mktemp("programs")), truth())


@pytest.fixture(scope="module")
def document(plan):
    return summary(plan, "part")


def test_the_total_is_that_of_the_plan(plan, document):
    assert document["total_time_s"] == pytest.approx(plan.total, abs=MILLISECOND / 2)
    assert document["path_length_mm"] == pytest.approx(plan.path.moves.length.sum(), abs=1e-6)
    assert document["program"] == "part"


def test_tools_and_types_each_add_up(plan, document):
    tools = document["by_tool"]
    room = MILLISECOND * (len(tools) + len(TYPES))
    assert sum(t["time_s"] for t in tools) == pytest.approx(plan.total, abs=room)
    assert sum(document["by_type"].values()) == pytest.approx(plan.total, abs=room)
    cutting = document["by_type"]["feed"] + document["by_type"]["arc"]
    assert sum(t["cutting_s"] for t in tools) == pytest.approx(cutting, abs=room)
    assert document["cutting_time_s"] == pytest.approx(cutting, abs=room)
    assert sum(t["rapid_s"] for t in tools) == pytest.approx(document["by_type"]["rapid"], abs=room)
    assert sum(t["length_mm"] for t in tools) == pytest.approx(document["path_length_mm"], abs=room)


def controls() -> dict[str, ControlParameters]:
    """One of each kind of motion: trapezoids, S-curves, tolerance and filters, dog-leg, blends."""
    plain = truth()
    jerky = {letter: replace(one, jerk=2e4) for letter, one in plain.axes.items()}
    return {
        "trapezoids": plain,
        "jerk": replace(plain, profile="s_curve", axes=jerky),
        "tolerance": replace(
            plain, corner="tolerance", rapid_filter=(0.02, 0.01), cutting_filter=(0.02, 0.01)
        ),
        "dog-leg": replace(plain, rapid_mode="independent"),
        "blend": replace(plain, corner="blend", settle_time=0.0, rapid_stop="change"),
    }


@pytest.mark.parametrize("kind", list(controls()))
def test_no_second_is_without_a_cause(kind, plan):
    planned = planned_program(plan.path.moves, controls()[kind])
    causes = time_by_cause(planned)
    assert sum(causes.values()) == pytest.approx(planned.total, rel=1e-9)
    assert min(causes.values()) >= -1e-9
    assert (
        causes["tool change"] == pytest.approx(6 * 4.6)
        and causes["corner"] + causes["tolerance"] > 0
    )


def test_a_ramp_takes_the_time_that_a_trapezoid_says():
    # 100 mm at 6000 mm/min is 1 s; from and to rest at 700 mm/s^2 each end costs v / (2 a)
    moves = Writer().set(feed=6000.0).to(X=100.0).to(X=200.0).moves
    causes = time_by_cause(planned_program(moves, replace(truth(), settle_time=0.0)))
    assert causes["feed"] == pytest.approx(2.0)
    assert causes["exact stop"] == pytest.approx(2 * 100.0 / (2 * 700.0))
    assert causes["acceleration"] == causes["corner"] == 0.0


def test_a_slow_corner_costs_what_it_costs_and_a_reversal_is_a_corner():
    slow = replace(truth(), settle_time=0.0)
    straight = Writer().set(feed=6000.0).to(X=100.0).to(X=200.0).moves
    bent = Writer().set(feed=6000.0).to(X=100.0).to(Y=100.0).moves
    one, two = (planned_program(moves, slow) for moves in (straight, bent))
    lost = time_by_cause(two)["corner"]
    assert lost == pytest.approx(two.total - one.total, rel=1e-6) and lost > 0.1


def test_tools_stand_in_the_order_in_which_they_are_used(document):
    assert [t["tool"] for t in document["by_tool"]] == [-1, 1, 2, 3, 4, 5, 6]


def test_a_tool_change_takes_what_the_control_says(document):
    assert document["by_type"]["tool change"] == pytest.approx(
        6 * truth().auxiliary.tool_change, abs=MILLISECOND
    )


def test_every_kind_of_row_has_a_type():
    kinds = np.array([kind.value for kind in Kind], dtype=np.uint8)
    words = dict(zip((kind.name for kind in Kind), type_of(kinds).tolist(), strict=True))
    assert set(words.values()) == set(TYPES)
    assert words["THREAD"] == words["PROBE"] == words["FEED"] == "feed"
    assert words["M_CODE"] == words["SPINDLE"] == words["STOP"] == words["END"]


def test_blocks_are_rows_of_json_that_add_up(plan):
    rows = blocks(plan)
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    assert {tuple(row) for row in rows} == {
        ("line", "type", "time_s", "length_mm", "reached_feed_mm_min", "limit")
    }
    assert [row["line"] for row in rows] == plan.path.moves.line.tolist()
    assert sum(row["time_s"] for row in rows) == pytest.approx(plan.total, abs=1e-6 * len(rows))
    assert {row["limit"] for row in rows} == set(limit_words(plan).tolist())


def test_the_table_says_the_same_as_the_blocks_and_where_each_move_ends(plan):
    table, rows, moves = block_table(plan), blocks(plan), plan.path.moves
    np.testing.assert_array_equal(table["line"], [row["line"] for row in rows])
    np.testing.assert_allclose(table["time"], [row["time_s"] for row in rows], atol=1e-6)
    np.testing.assert_array_equal(table[["x", "y", "z"]], moves.end[:, :3])
    cutting = np.isin(moves.kind, (Kind.FEED, Kind.ARC))
    programmed = table["programmed_feed"].to_numpy()
    assert np.isnan(programmed[~cutting]).all()
    np.testing.assert_allclose(programmed[cutting], moves.feed[cutting], rtol=1e-12)
    assert (table["reached_feed"][cutting] <= programmed[cutting] * (1 + 1e-9)).all()


def test_a_feed_per_revolution_is_programmed_in_mm_per_minute():
    """0.2 mm/rev at 1000 rev/min is 200 mm/min."""
    writer = Writer().set(feed=0.2, feed_mode=95, speed=1000.0, direction=1).to(X=50.0)
    table = block_table(planned_program(writer.moves, truth()))
    assert table["programmed_feed"].tolist() == pytest.approx([200.0])


def test_overrides_act_row_by_row(plan):
    moves = plan.path.moves
    half = np.where(moves.tool == 3, 0.5, 1.0)
    slower = planned_program(moves, truth(), Overrides(feed=half, rapid=1.0, spindle=1.0))
    third = moves.tool == 3
    np.testing.assert_allclose(slower.time[~third], plan.time[~third], rtol=1e-9)
    on_feed = third & (moves.kind == Kind.FEED) & (plan.time > 2.0)  # long enough to be at feed
    assert on_feed.any()
    np.testing.assert_allclose(slower.time[on_feed] / plan.time[on_feed], 2.0, rtol=0.05)


def test_the_trace_ends_where_and_when_the_program_does(plan, tmp_path):
    shares = []
    samples = write_trace(plan, tmp_path / "trace.parquet", shares.append)
    table = pq.read_table(tmp_path / "trace.parquet")
    period = plan.path.control.interpolation_period
    assert table.num_rows == samples
    assert table.schema.field("x").metadata == {b"unit": b"mm"}
    assert table.column_names == [
        "time", "line", "x", "y", "z", "programmed_x", "programmed_y", "programmed_z",
    ]  # fmt: skip
    frame = table.to_pandas()
    assert plan.total <= frame["time"].iloc[-1] < plan.total + period
    np.testing.assert_allclose(np.diff(frame["time"]), period, atol=1e-9)
    end = plan.path.moves.end[-1, :3]
    np.testing.assert_allclose(frame[["x", "y", "z"]].iloc[-1], end, atol=1e-9)
    assert frame["line"].is_monotonic_increasing
    assert frame["line"].iloc[-1] == plan.path.moves.line[-1]
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0, abs=1e-4)


def test_the_speed_of_the_trace_is_the_feed_that_the_blocks_reach(plan, tmp_path):
    write_trace(plan, tmp_path / "trace.parquet")
    frame = pq.read_table(tmp_path / "trace.parquet").to_pandas()
    step = np.diff(frame[["x", "y", "z"]].to_numpy(), axis=0)
    speed = np.sqrt((step**2).sum(axis=1)) / plan.path.control.interpolation_period * 60
    # a chord between two samples is never longer than the path
    assert speed.max() == pytest.approx(plan.v_peak.max() / METRE_PER_SECOND, rel=1e-3)


def test_only_axes_that_move_have_columns(tmp_path):
    control = ControlParameters(axes={"X": axis(), "C": axis()})
    moves = Writer().set(feed=600.0).to(C=90.0).moves
    write_trace(planned_program(moves, control), tmp_path / "trace.parquet")
    table = pq.read_table(tmp_path / "trace.parquet")
    schema = table.schema
    assert table.column("c")[-1].as_py() == pytest.approx(90.0, abs=1e-9)
    assert schema.names == ["time", "line", "c", "programmed_c"]
    assert schema.field("c").metadata == {b"unit": b"deg"}


def test_a_program_without_rows_has_no_trace(tmp_path):
    with pytest.raises(ValueError, match="the program has no rows"):
        write_trace(planned_program(Writer().moves, truth()), tmp_path / "trace.parquet")
    assert summary(planned_program(Writer().moves, truth()), "none")["total_time_s"] == 0.0


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    raw = tmp_path_factory.mktemp("raw")
    out = raw.parent / "out"
    (raw / "programs").mkdir()
    good, bad = raw / "programs/good.nc", raw / "programs/bad.nc"
    good.write_text("\n".join(exciting()) + "\n")
    bad.write_text("G21 G90\nG1 X10 F500\nG2 X20 Y0 I500 F100\nM30\n")
    simulate_files(
        {"good": good, "bad": bad}, raw, truth(), SETUP, out, machine="mill", origin="simulated"
    )
    return raw, out


def test_a_program_is_stored_with_its_times_and_the_bytes_it_was_read_from(written):
    raw, out = written
    path = raw / "programs/good.nc"
    document = json.loads((out / "good.json").read_text())
    plan = planned_program(program_moves(path, SETUP), truth())
    assert document["total_time_s"] == pytest.approx(plan.total, abs=5e-4)
    assert document["refused"] is None
    assert document["sha256"] == sha256(path.read_bytes()).hexdigest()
    assert (document["file"], document["program"]) == ("programs/good.nc", "good")
    assert (document["machine"], document["origin"]) == ("mill", "simulated")
    table = pd.read_parquet(out / "good.parquet")
    assert len(table) == document["blocks"] == len(plan.path.moves)
    assert table["time"].sum() == pytest.approx(plan.total, rel=1e-12)


def test_a_program_that_cannot_be_followed_is_refused_with_file_and_line(written):
    _, out = written
    document = json.loads((out / "bad.json").read_text())
    assert "bad.nc:3:" in document["refused"]
    assert document["total_time_s"] is None
    assert not (out / "bad.parquet").exists()
