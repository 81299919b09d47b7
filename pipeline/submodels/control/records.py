"""Records of a control: logs of runs, the programs that they executed, and both matched."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import Moves
from pipeline.gcode.setup import Setup
from pipeline.submodels.control.programs import Match, match
from pipeline.submodels.control.runs import read_runs
from pipeline.twin.program import program_moves


@dataclass(frozen=True, kw_only=True)
class ControlRecords:
    """Recordings of runs of programs, and the programs.

    Parameters
    ----------
    logs : str
        Pattern of the recordings' names below the machine's folder.
    programs : str
        Pattern of the part programs there.
    units : mapping of str to str
        Where several machines of a kind are taken as one: name -> pattern of its recordings.
    default_unit : str
        Whose control programs are simulated with when nobody names another.
    simulate : tuple of str
        Patterns of the programs that the report shows.
    """

    logs: str
    programs: str
    units: Mapping[str, str] = field(default_factory=dict)
    default_unit: str = ""
    simulate: tuple[str, ...] = ("*",)

    def __post_init__(self) -> None:
        if self.units and self.default_unit not in self.units:
            raise ValueError(
                f"control_records.default_unit is {self.default_unit!r}: "
                f"name one of its units, {', '.join(self.units)}"
            )

    def shown(self, raw: Path) -> list[Path]:
        """Programs below ``raw`` that the report shows."""
        return [
            path
            for path in sorted(raw.glob(self.programs))
            if any(fnmatchcase(path.relative_to(raw).as_posix(), p) for p in self.simulate)
        ]

    def unit(self, recording: str) -> str:
        """Which machine of the kind a recording is of; "" where there is one only.

        Raises
        ------
        ValueError
            When there are units and none of their patterns fits.
        """
        for name, pattern in self.units.items():
            if fnmatchcase(recording, pattern):
                return name
        if self.units:
            raise ValueError(
                f"recording {recording} fits no pattern of control_records.units "
                f"({', '.join(self.units.values())}): add its unit in conf/machine/"
            )
        return ""


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
