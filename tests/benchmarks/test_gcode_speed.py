"""Seconds and bytes that a part program takes from text to moves on one core."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

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
