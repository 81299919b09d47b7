"""Nanoseconds a block that planning takes on one core: geometry, planning again, populations."""

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import control, row_times

ROWS = 100_000


def finishing(rows: int) -> Moves:
    """A freeform surface in rows of short chords, as a CAM system writes it."""
    rng = np.random.default_rng(7)
    t = np.arange(1, rows + 1) / 200
    end = np.zeros((rows, 6))
    end[:, 0] = 40 * np.abs((t % 2) - 1)
    end[:, 1] = np.floor(t) * 0.3
    end[:, 2] = 5 * np.sin(end[:, 0] / 4) * np.cos(end[:, 1] / 7)
    end[:, :3] = np.round(end[:, :3] + rng.normal(0, 2e-4, (rows, 3)), 3)
    zeros = {
        "file": np.int16, "angle": float, "speed": float, "direction": np.int8,
        "constant_surface_speed": bool, "tool": np.int32, "frame": np.int32, "path_mode": np.uint8,
        "tolerance": float, "code": np.int32, "value": float,
    }  # fmt: skip
    return Moves(
        origin=np.zeros(6),
        kind=np.ones(rows, np.uint8),
        line=np.arange(1, rows + 1, dtype=np.int32),
        end=end,
        centre=np.full((rows, 3), np.nan),
        plane=np.full(rows, 17, np.uint8),
        feed=np.full(rows, 3000.0),
        feed_mode=np.full(rows, 94, np.uint8),
        files=("surface.nc",),
        **{name: np.zeros(rows, dtype) for name, dtype in zeros.items()},
    )


CONTROLS = {
    "jump": control(),
    "tolerance": control(corner="tolerance", tolerance=0.01, cutting_filter=(0.016, 0.008)),
}


@pytest.mark.parametrize("corner", CONTROLS)
def test_geometry_and_plan(benchmark, corner: str) -> None:
    moves = finishing(ROWS)
    benchmark(lambda: plan(limited_path(moves, CONTROLS[corner])))
    assert benchmark.stats["min"] / ROWS < 500e-9


@pytest.mark.parametrize("rows", [1000, ROWS])
def test_plan_again_with_other_feeds(benchmark, rows: int) -> None:
    path = limited_path(finishing(rows), CONTROLS["jump"])
    feeds = np.random.default_rng(1).uniform(500, 6000, rows)
    benchmark(lambda: plan(path, feeds=feeds))
    # at 1000 rows what does not depend on their number counts as well
    assert benchmark.stats["min"] / rows < (100e-9 if rows > 1000 else 300e-9)


@pytest.mark.parametrize("rows", [1000, 10_000, ROWS])
def test_population(benchmark, rows: int) -> None:
    path = limited_path(finishing(rows), CONTROLS["jump"])
    feeds = np.random.default_rng(1).uniform(500, 6000, (32, rows))
    speeds = np.tile(path.moves.speed, (32, 1))
    benchmark(lambda: row_times(path, feeds, speeds))
    assert benchmark.stats["min"] / rows / 32 < 50e-9


def test_s_curve(benchmark) -> None:
    moves = finishing(10_000)
    path = limited_path(moves, control(profile="s_curve", limits={"jerk": 50_000}))
    benchmark(lambda: plan(path))
    assert benchmark.stats["min"] / len(moves) < 50e-6


def test_interpolation(benchmark) -> None:
    result = plan(limited_path(finishing(10_000), CONTROLS["tolerance"]))
    samples = len(trace(result))
    benchmark(lambda: trace(result))
    assert benchmark.stats["min"] / samples < 1e-6


def test_text_to_times(benchmark) -> None:
    lines = [f"X{x:.3f} Y{y:.3f} Z{z:.3f}" for x, y, z in finishing(ROWS).end[:, :3]]
    text = ("G21 G90 G17 G94\nG1 F3000\n" + "\n".join(lines) + "\nM30\n").encode()

    def planned() -> float:
        moves = interpret(parse_program(text, "surface.nc"), Setup())
        assert len(moves) > ROWS
        return plan(limited_path(moves, CONTROLS["jump"])).total

    benchmark(planned)
    assert benchmark.stats["min"] < 0.4
