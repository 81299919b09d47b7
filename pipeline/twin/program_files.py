"""Simulated programs on disk: a JSON and a Parquet for each, for the report."""

import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.twin.program import planned_program, program_moves
from pipeline.twin.simulation import block_table, summary


def simulate_files(
    files: Sequence[Path],
    raw: Path,
    control: ControlParameters,
    setup: Setup,
    out: Path,
    machine: str,
    origin: str,
) -> None:
    """Simulate each of ``files``; what cannot be followed is written down as refused.

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
        head: dict[str, Any] = {
            "machine": machine,
            "origin": origin,
            "file": path.relative_to(raw).as_posix(),
            "sha256": sha256(path.read_bytes()).hexdigest(),
        }
        try:
            plan = planned_program(program_moves(path, setup), control)
        except GcodeError as error:
            document = {"program": path.stem, "refused": str(error), **head}
        else:
            table = block_table(plan)
            document = {**summary(plan, path.stem), "refused": None, **head, "blocks": len(table)}
            table.to_parquet(out / f"{path.stem}.parquet", compression="zstd")
        (out / f"{path.stem}.json").write_text(json.dumps(document, indent=2) + "\n")
