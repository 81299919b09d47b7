"""Records of a control: logs of runs, the programs that they executed, and both matched."""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import Moves
from pipeline.gcode.setup import Setup
from pipeline.submodels.control.programs import Match, match
from pipeline.submodels.control.runs import read_runs
from pipeline.twin.control import ControlRecords
from pipeline.twin.program import program_moves


@dataclass(frozen=True, kw_only=True)
class Programs:
    """Programs of a machine: moves by file name, and why others could not be read."""

    moves: Mapping[str, Moves]
    refused: Mapping[str, str]


def read_programs(raw: Path, records: ControlRecords, setup: Setup) -> Programs:
    """Every part program below ``raw`` that ``records`` names."""
    moves: dict[str, Moves] = {}
    refused: dict[str, str] = {}
    for path in sorted(raw.glob(records.programs)):
        name = path.relative_to(raw).as_posix()
        try:
            moves[name] = program_moves(path, setup)
        except GcodeError as error:
            refused[name] = str(error)
    return Programs(moves=moves, refused=refused)


def read_matches(
    signals: Path,
    files: Mapping[str, Mapping[str, Any]],
    records: ControlRecords,
    items: Mapping[str, str],
    programs: Mapping[str, Moves],
) -> list[Match]:
    """Every run of a program in the recordings, in the order of their names.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote it.
    files : mapping of str to mapping
        Entries of its manifest by raw file.
    records : ControlRecords
        Which of the recordings.
    items : mapping of str to str
        Signal -> data item.
    programs : mapping of str to Moves
        Those that may have run, by name.
    """
    found: list[Match] = []
    for name, entry in sorted(files.items()):
        if entry["output"] is None or not fnmatchcase(name, records.logs):
            continue
        runs = read_runs(signals / entry["output"], items, name)
        found += [match(run, programs) for run in runs]
    return found
