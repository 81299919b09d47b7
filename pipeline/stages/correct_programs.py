"""Stage: corrected commands of the feed axes for the programs of a machine."""

from pathlib import Path

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.setup import Setup
from pipeline.schema.bundle import bundle_words
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import write_text
from pipeline.submodels.following_residual.model import residual_of
from pipeline.twin.command_correction import (
    CommandCorrectionSettings,
    CorrectedProgram,
    corrected_program,
    write_corrected,
)
from pipeline.twin.control import (
    ControlRecords,
    control_of_unit,
    planned_program,
    program_moves,
    read_controls,
)
from pipeline.twin.drive import read_drives


def correct_programs(
    raw: Path,
    champion: Path,
    written: Path,
    *,
    identity: MachineIdentity,
    setup: Setup,
    control_records: ControlRecords,
    command_correction: CommandCorrectionSettings,
) -> None:
    """Write a corrected command, ``<program>.csv``, for each program that the report shows."""
    written.mkdir(parents=True, exist_ok=True)
    control = control_of_unit(
        read_controls(champion / "control/model.json"), control_records.default_unit
    )
    model = champion / "drive/model.json"
    drives = read_drives(model) if model.exists() else {}
    residual, words = residual_of(champion)
    for name, path in control_records.shown(raw).items():
        out = written / f"{name}.csv"
        try:
            plan = planned_program(program_moves(path, setup), control)
            axes, cutting = corrected_program(
                plan,
                drives,
                residual,
                settings=command_correction,
                longest=command_correction.longest_s,
            )
        except (GcodeError, ValueError) as error:
            write_text(f"# Kerf: no corrected command of {name}: {error}\n", out)
            continue
        done = CorrectedProgram(
            machine=identity.name, origin=identity.origin, program=name,
            champion=bundle_words(champion), residual=words, total=plan.total, axes=axes,
            cutting=cutting,
        )  # fmt: skip
        write_corrected(done, out)
