"""Programs of other people, each as the control or a manual has it: the value, or the sentence."""

import pytest
from typer.testing import CliRunner

from pipeline.app.kerf import app
from pipeline.gcode.moves import Kind
from tests.gcode.following import follow, points

TAPPING = "G20G90G17\nS200M3\nG0X0Y0Z1.\nG98G84Z-.292R.1Q.05F4.83\nX1.\nX2.\nX3.\nG80\nM30\n"


def feed_seconds(moves) -> float:
    """Time of the cuts as path over feed [s]."""
    cuts = (moves.kind == Kind.FEED) | (moves.kind == Kind.ARC)
    return float((moves.length[cuts] / moves.feed[cuts]).sum() * 60)


def test_peck_tapping_goes_back_to_r_and_reverses_at_each_peck():
    # depths 0.05 … 0.35 and 0.392 inch below R, down and up, four holes at 4.83 inch/min
    path = 4 * 2 * (0.05 * (1 + 2 + 3 + 4 + 5 + 6 + 7) + 0.392)
    moves = follow(TAPPING)
    assert feed_seconds(moves) == pytest.approx(path / 4.83 * 60)
    reversals = (moves.kind == Kind.SPINDLE) & (moves.code != 3)
    assert reversals.sum() == 4 * 8 * 2
    assert "G84 with Q is peck tapping" in moves.notices[0]


def test_peck_tapping_retracts_by_the_amount_of_the_control():
    moves = follow("G90 S200 M3 G0 Z10\nG99 G84 Z-3 R2 Q2 F200", tapping_retract=0.5)
    assert [z for _, _, z in points(moves)] == [10, 2, 0, 0.5, -2, -1.5, -3, 2]
    assert not moves.notices


def test_a_dwell_has_its_time_in_the_table(tmp_path):
    (tmp_path / "a.nc").write_text("G21\nG4 P2500\nM3 S120\nM30\n")
    out = tmp_path / "o.csv"
    done = CliRunner().invoke(app, ["interpret", str(tmp_path / "a.nc"), "--out", str(out)])
    assert done.exit_code == 0, done.output
    head, dwell, *_ = (line.split(",") for line in out.read_text().splitlines())
    assert float(dwell[[name.strip('"') for name in head].index("dwell_s")]) == 2.5
