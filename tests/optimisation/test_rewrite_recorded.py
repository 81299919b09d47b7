"""Recorded programs with any feeds and speeds: proved the same, and the same to LinuxCNC."""

import os
from pathlib import Path

import numpy as np
import pytest

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup, Tool
from pipeline.optimisation.proof.prove import prove, with_proof_comment
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from tests.gcode.rs274 import RS274, Answer, Oracle
from tests.optimisation.modal_programs import any_answer

FOLDER = Path(os.environ.get("KERF_RECORDINGS") or ".")
LINUXCNC = FOLDER / "gcode" / "linuxcnc" / "nc_files"
NIST = FOLDER / "nist_box" / "programs"
pytestmark = pytest.mark.skipif(
    not (LINUXCNC.is_dir() and NIST.is_dir()),
    reason="KERF_RECORDINGS names no folder with gcode/linuxcnc and nist_box/programs",
)
TOOLS = {number: (0.0, 1.0 + number % 5) for number in range(1, 100)}
"""Number -> length, diameter [mm]."""
SETUP = Setup(
    dialect="linuxcnc", inch_machine=True,
    tools={n: Tool(length=length, diameter=d) for n, (length, d) in TOOLS.items()},
)  # fmt: skip
FEW = [pytest.param(8, id="every-eighth"), pytest.param(1, id="all", marks=pytest.mark.proof)]
"""One of how many programs is rewritten: in the ordinary suite, and as proof."""
READ = 96
"""Programs of LinuxCNC's that are followed, at least."""
LONGEST = 250_000
"""Bytes of a program that LinuxCNC's interpreter is asked about."""


def _turning(text: bytes) -> bytes:
    """A program whose spindle turns from the first line on: else nothing in it would cut."""
    lines = text.splitlines(keepends=True)
    at = int(bool(lines) and lines[0].lstrip().startswith(b"%"))
    return b"".join([*lines[:at], b"M3 S3000\n", *lines[at:]])


def _rewritten(text: bytes, name: str, setup: Setup, seed: int) -> tuple[bytes, int]:
    """The program with any answer in it, proved; how many words were changed."""
    program, rng = Program(text, name), np.random.default_rng(seed)
    moves = interpret(program, setup)
    editable = editable_blocks(program, moves)
    feeds, speeds = any_answer(editable, moves, rng)
    made = rewrite(program, moves, editable, feeds, speeds, setup)
    proof = prove(text, made.text, name, name, setup)
    assert proof.same, f"{name}: {proof.first}"
    assert proof.differences == made.changes
    signed = with_proof_comment(made.text, proof)
    assert prove(text, signed, name, name, setup).sha256 == proof.sha256
    return made.text, len(made.changes)


@pytest.mark.parametrize("each", FEW)
def test_programs_of_a_box_and_plates(each: int) -> None:
    words = {}
    paths = sorted(NIST.iterdir(), key=lambda path: (path.stat().st_size, path.name))
    for path in paths[::each]:
        words[path.name] = _rewritten(path.read_bytes(), path.name, Setup(), seed=1)[1]
    assert len(words) == 8 // each
    # of 1187 to 4183 moves a program nearly all cut, and most of those were given another F
    assert min(words.values()) > 900


@pytest.mark.parametrize("each", FEW)
def test_programs_of_linuxcnc(each: int) -> None:
    read = words = 0
    for path in sorted(LINUXCNC.rglob("*.ngc"))[::each]:
        setup = Setup(**{**vars(SETUP), "folders": (path.parent, LINUXCNC)})
        text = _turning(path.read_bytes())
        try:
            interpret(Program(text, path.name), setup)
        except GcodeError:
            continue
        read += 1
        words += _rewritten(text, path.name, setup, seed=2)[1]
    assert read >= READ // (2 * each - 1) and words > (5_000 if each == 1 else 100)


def _same_geometry(before: Answer, after: Answer) -> None:
    """LinuxCNC's own canonical moves: the same bits."""
    assert before.error == after.error == ""
    for name in ("ends", "rapid", "lengths", "arcs"):
        assert getattr(before, name).tobytes() == getattr(after, name).tobytes(), name
    assert before.dwell == after.dwell and before.probed == after.probed


@pytest.mark.parametrize("each", FEW)
@pytest.mark.skipif(not RS274.exists(), reason=f"{RS274} is not installed")
def test_linuxcnc_makes_the_same_moves(tmp_path: Path, each: int) -> None:
    oracle, asked = Oracle(tmp_path, TOOLS, (LINUXCNC,)), 0
    paths = [*sorted(LINUXCNC.glob("*.ngc")), *sorted(NIST.iterdir())]
    for path in paths[::each]:
        text = _turning(path.read_bytes())
        setup = Setup(**{**vars(SETUP), "folders": (LINUXCNC,)})
        try:
            interpret(Program(text, path.name), setup)
        except GcodeError:
            continue
        if len(text) > LONGEST:
            continue
        place = tmp_path / "asked.ngc"
        place.write_bytes(text)
        before = oracle.ask(place)
        if before.error:
            continue
        place.write_bytes(_rewritten(text, path.name, setup, seed=3)[0])
        _same_geometry(before, oracle.ask(place))
        asked += 1
    assert asked >= 30 // (2 * each - 1)
