"""Simulated programs on disk: a summary (JSON) and a table of moves (Parquet) for each."""

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.program import SimulatedProgram
from pipeline.schema.store import write_json
from pipeline.schema.structure import structured
from pipeline.twin.program import planned_program, program_moves
from pipeline.twin.simulation import block_table, summary


def simulate_files(
    files: Sequence[Path],
    raw: Path,
    control: ControlParameters,
    setup: Setup,
    out: Path,
    *,
    machine: str,
    origin: str,
) -> None:
    """Simulate each of ``files``; a program that cannot be followed is stored as refused.

    Parameters
    ----------
    files : sequence of Path
        Part programs.
    raw : Path
        Folder that names are given below.
    control : ControlParameters
        Whose times they are.
    setup : Setup
        Of the machine before each program.
    out : Path
        Folder to write ``<stem>.json`` and ``<stem>.parquet`` into.
    machine, origin : str
        Whose control it is, and whether its records are simulated.
    """
    out.mkdir(parents=True, exist_ok=True)
    for path in files:
        program = SimulatedProgram(
            program=path.stem,
            machine=machine,
            origin=origin,
            file=path.relative_to(raw).as_posix(),
            sha256=sha256(path.read_bytes()).hexdigest(),
        )
        try:
            plan = planned_program(program_moves(path, setup), control)
        except GcodeError as error:
            program = replace(program, refused=str(error))
        else:
            table = block_table(plan)
            times = structured(summary(plan, path.stem), SimulatedProgram, path.stem)
            program = replace(
                times, machine=machine, origin=origin, file=program.file, sha256=program.sha256,
                blocks=len(table),
            )  # fmt: skip
            table.to_parquet(out / f"{path.stem}.parquet", compression="zstd")
        write_json(program, out / f"{path.stem}.json")
