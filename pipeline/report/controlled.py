"""Facts about the control: its parameters, how well it predicts runs, its programs move by move."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.charts.numbers import real
from pipeline.charts.sources import Shelf, rows_of, shown
from pipeline.report.folders import MachineFolders
from pipeline.report.program_moves import COLUMNS, ProgramMoves, program_moves

LOGS = "logs of runs and the programs that ran"


@dataclass(frozen=True, kw_only=True)
class Program:
    """One part program as the control would run it; ``moves`` is None where nothing can be drawn.

    ``files`` are what is said of it: the summary and the table of moves.
    """

    name: str
    document: dict[str, Any]
    moves: ProgramMoves | None
    files: tuple[Path, Path]

    @property
    def refused(self) -> str:
        """Why it could not be read; empty when it could."""
        return str(self.document.get("refused") or "")

    @property
    def seconds(self) -> float | None:
        """Predicted time [s]."""
        return real(self.document.get("total_time_s"))


@dataclass(frozen=True, kw_only=True)
class Controlled:
    """What is known of the control; None where the file that would say it is absent."""

    control: dict[str, Any] | None = None
    validation: dict[str, Any] | None = None
    programs: list[Program] = field(default_factory=list)

    @property
    def limit(self) -> float | None:
        """Largest error of a run's time that passes [%]."""
        return real((self.validation or {}).get("limit_percent"))

    @property
    def runs(self) -> list[dict[str, Any]]:
        """Every run whose time was predicted: the judged first, then by name."""
        runs = rows_of(self.validation, "runs")
        return sorted(runs, key=lambda r: (not is_judged(r), str(r.get("run"))))

    @property
    def judged(self) -> list[dict[str, Any]]:
        """Runs that nothing was learnt from and that ran to their end."""
        return [run for run in self.runs if is_judged(run)]


def is_judged(run: dict[str, Any]) -> bool:
    """Whether a run counts: not learnt from, run to its end, with a known error."""
    complete = run.get("role") == "judged" and run.get("completed") is True
    return complete and real(run.get("error_percent")) is not None


def run_status(run: dict[str, Any], limit: float | None) -> str:
    """Verdict of one run: ``passed``, ``failed``, or ``unknown`` where it does not count."""
    error = real(run.get("error_percent"))
    if not is_judged(run) or error is None or limit is None:
        return "unknown"
    return "passed" if abs(error) <= limit else "failed"


def controlled(folders: MachineFolders, shelf: Shelf) -> Controlled:
    """What the files of the control, of its judgement and of its programs say."""
    programs = [
        _program(path, shelf) for path in sorted((folders.models / "programs").glob("*.json"))
    ]
    return Controlled(
        control=shelf.document(folders.models / "control.json", LOGS),
        validation=shelf.document(
            folders.models / "control_validation.json", "control.json and logs of runs"
        ),
        programs=sorted(
            (p for p in programs if p is not None), key=lambda p: (-(p.seconds or 0.0), p.name)
        ),
    )


def _program(path: Path, shelf: Shelf) -> Program | None:
    document = shelf.document(path, "the part program and control.json")
    if document is None:
        return None
    table_path = path.with_suffix(".parquet")
    moves = None
    if not document.get("refused"):
        table = shelf.table(table_path, COLUMNS, "the part program and control.json")
        if table is not None:
            try:
                moves = program_moves(table, document.get("origin_mm"))
            except pa.ArrowException as error:
                shelf.broken[shown(table_path)] = f"its columns are not those of moves: {error}"
    name = str(document.get("program") or path.stem)
    return Program(name=name, document=document, moves=moves, files=(path, table_path))
