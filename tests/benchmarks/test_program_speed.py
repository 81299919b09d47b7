"""Seconds and bytes from text to moves, and nanoseconds a block of planning, on one core."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import control, row_times

LINES = 100_000

FOLLOW = """
import resource, sys, time
from pathlib import Path
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
data, setup = Path(sys.argv[1]).read_bytes(), Setup(dialect=sys.argv[2])
head = data[: data.rindex(b"\\n", 0, 4000)]
interpret(parse_program(head, "warm"), setup)
best = float("inf")
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for turn in range(5):
    begin = time.process_time()
    program = parse_program(data, "part")
    parsed = time.process_time()
    moves = interpret(program, setup)
    end = time.process_time()
    if turn == 0:
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    best = min(best, end - begin)
tokens = program.tokens
kept = len(data) + sum(a.nbytes for a in (tokens.kind, tokens.start, tokens.first))
kept += sum(array.nbytes for _, array in moves.columns())
print(len(program), len(moves), best, parsed - begin, kept, grown * 1024)
"""


def finishing(numbers: Callable[[float, float, float], str]) -> str:
    """Lanes of a ball-nose finish over a wavy surface: short lines, some arcs and lifts."""
    rng = np.random.default_rng(5)
    lines = ["G21 G90 G17 G94", "S12000 M3", "G0 X0 Y0 Z5", "G1 F3000"]
    x, y, row = 0.0, 0.0, 0
    while len(lines) < LINES - 1:
        x += float(rng.uniform(0.05, 0.6))
        if x > 120:
            row, x, y = row + 1, 0.0, y + 0.25
            lines += ["G0 Z5", numbers(0.0, y, 5.0).replace("G1", "G0"), "G1 F2500"]
        z = 3 * np.sin(x / 9) * np.cos(y / 7) - 4
        lines.append(numbers(x, y, float(z)))
        if len(lines) % 50 == 0:
            lines.append("G91 G3 X0.2 Y0.2 I0.2 J0 (blend)")
            lines.append("G90 G1")
    return "\n".join([*lines[: LINES - 1], "M30", ""])


def plain(x: float, y: float, z: float) -> str:
    return f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f}"


def scaled(x: float, y: float, z: float) -> str:
    """As 3D_Chips.ngc, an example of LinuxCNC, is written."""
    return f"G1X[#<xscale>*{x:.3f}]Y[#<yscale>*{y:.3f}]Z[#<zscale>*{z:.3f}]"


@pytest.mark.parametrize(
    ("dialect", "numbers", "bytes_a_block"), [("fanuc", plain, 300), ("linuxcnc", scaled, 350)]
)
def test_text_to_moves(  # type: ignore[no-untyped-def]
    dialect: str, numbers: Callable[..., str], bytes_a_block: int, tmp_path: Path, benchmark, capsys
) -> None:
    path = tmp_path / "part.ngc"
    head = "#<xscale>=1.0\n#<yscale>=1.0\n#<zscale>=1.0\n" if dialect == "linuxcnc" else ""
    path.write_text(head + finishing(numbers))
    results = []

    def follow() -> None:
        told = subprocess.run(
            [sys.executable, "-c", FOLLOW, str(path), dialect],
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        results.append([float(word) for word in told.stdout.split()])

    benchmark.pedantic(follow, rounds=2, iterations=1)
    lines, moves, took, parsed, kept, grown = min(results, key=lambda r: r[2])
    with capsys.disabled():
        sys.stdout.write(
            f"\n{dialect}: {lines:.0f} lines, {moves:.0f} moves in {took * 1e3:.0f} ms (scan "
            f"{parsed * 1e3:.0f} ms), {took / lines * 1e6:.2f} µs a line; "
            f"{kept / lines:.0f} bytes a line kept, {grown / lines:.0f} at the peak\n"
        )
    assert moves > 0.9 * LINES
    assert took < 0.3
    assert kept / lines <= bytes_a_block


COMMAND = """
import resource, sys, time
from pipeline.app import main
try:
    main()
finally:
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(used.ru_maxrss / 1024, used.ru_utime + used.ru_stime, file=sys.stderr)
"""


MOST_MEMORY = 477
"""500 MB [MiB]."""


@pytest.mark.parametrize("megabytes", [10, 50])
def test_memory_of_the_command(megabytes: int, tmp_path: Path, benchmark, capsys) -> None:  # type: ignore[no-untyped-def]
    """`kerf interpret` of a finish of short lines, its table written too."""
    path, piece = tmp_path / "part.nc", finishing(plain).removesuffix("M30\n").encode()
    path.write_bytes(piece * round(megabytes * 1e6 / len(piece)) + b"M30\n")
    results = []

    def follow() -> None:
        words = ["interpret", str(path), "--out", str(tmp_path / "moves.csv")]
        told = subprocess.run(
            [sys.executable, "-c", COMMAND, *words], check=True, capture_output=True, text=True
        )
        results.append([float(word) for word in told.stderr.split()[-2:]])

    benchmark.pedantic(follow, rounds=2, iterations=1)
    memory, took = min(results)
    with capsys.disabled():
        sys.stdout.write(f"\n{megabytes} MB: {memory:.0f} MiB, {took:.1f} s of processor time\n")
    assert memory < MOST_MEMORY


ROWS = 100_000


def surface(rows: int) -> Moves:
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
    moves = surface(ROWS)
    benchmark(lambda: plan(limited_path(moves, CONTROLS[corner])))
    assert benchmark.stats["min"] / ROWS < 500e-9


@pytest.mark.parametrize("rows", [1000, ROWS])
def test_plan_again_with_other_feeds(benchmark, rows: int) -> None:
    path = limited_path(surface(rows), CONTROLS["jump"])
    feeds = np.random.default_rng(1).uniform(500, 6000, rows)
    benchmark(lambda: plan(path, feeds=feeds))
    # at 1000 rows what does not depend on their number counts as well
    assert benchmark.stats["min"] / rows < (100e-9 if rows > 1000 else 300e-9)


@pytest.mark.parametrize("rows", [1000, 10_000, ROWS])
def test_population(benchmark, rows: int) -> None:
    path = limited_path(surface(rows), CONTROLS["jump"])
    feeds = np.random.default_rng(1).uniform(500, 6000, (32, rows))
    speeds = np.tile(path.moves.speed, (32, 1))
    benchmark(lambda: row_times(path, feeds, speeds))
    assert benchmark.stats["min"] / rows / 32 < 50e-9


def test_s_curve(benchmark) -> None:
    moves = surface(10_000)
    path = limited_path(moves, control(profile="s_curve", limits={"jerk": 50_000}))
    benchmark(lambda: plan(path))
    assert benchmark.stats["min"] / len(moves) < 50e-6


def test_interpolation(benchmark) -> None:
    result = plan(limited_path(surface(10_000), CONTROLS["tolerance"]))
    samples = len(trace(result))
    benchmark(lambda: trace(result))
    assert benchmark.stats["min"] / samples < 1e-6


def test_text_to_times(benchmark) -> None:
    lines = [f"X{x:.3f} Y{y:.3f} Z{z:.3f}" for x, y, z in surface(ROWS).end[:, :3]]
    text = ("G21 G90 G17 G94\nG1 F3000\n" + "\n".join(lines) + "\nM30\n").encode()

    def planned() -> float:
        moves = interpret(parse_program(text, "surface.nc"), Setup())
        assert len(moves) > ROWS
        return plan(limited_path(moves, CONTROLS["jump"])).total

    benchmark(planned)
    assert benchmark.stats["min"] < 0.4
