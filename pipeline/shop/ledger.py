"""The truth: what was simulated and every piece of dirt, written for tests and the report."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.timeline import Cycle


@dataclass(kw_only=True)
class Glitch:
    """One wrong value in the log; ``value`` as it is written."""

    kind: str
    item: str
    time: str
    value: str


@dataclass(kw_only=True)
class Burst:
    """All items became unavailable; ``late`` bursts stand after lines that are younger."""

    kind: str  # agent_start, power_off, disconnect
    time: str
    lines: int
    late: bool


@dataclass(kw_only=True)
class Unobserved:
    """A stretch in which the machine was on and the log does not say what it did."""

    cause: str  # disconnect, silence
    start: str
    end: str


@dataclass(kw_only=True)
class LogFile:
    """One file of the log: all lines, those that cannot be read, those older than one before."""

    file: str
    lines: int
    records: int
    rejected: int
    out_of_order: int


@dataclass(kw_only=True)
class Ledger:
    """All that a reader of the records should find out."""

    glitches: list[Glitch] = field(default_factory=list)
    bursts: list[Burst] = field(default_factory=list)
    unobserved: list[Unobserved] = field(default_factory=list)
    late_lines: list[dict[str, str]] = field(default_factory=list)
    rejected: list[dict[str, str]] = field(default_factory=list)
    log_files: list[LogFile] = field(default_factory=list)
    cycles: list[Cycle] = field(default_factory=list)
    days: list[dict[str, str]] = field(default_factory=list)
    thermocouples: dict[str, Any] = field(default_factory=dict)
    heat: dict[str, float] = field(default_factory=dict)
    control: dict[str, Any] = field(default_factory=dict)
    drives: dict[str, Any] = field(default_factory=dict)
    cutting: dict[str, Any] = field(default_factory=dict)


def stamp(start: np.datetime64, seconds: float, digits: int = 3) -> str:
    """ISO time (UTC) ``seconds`` after ``start``, with 3 or 6 ``digits`` of a second."""
    if digits == 3:
        moment = start.astype("datetime64[ms]") + np.timedelta64(round(seconds * 1e3), "ms")
    else:
        moment = start.astype("datetime64[us]") + np.timedelta64(round(seconds * 1e6), "us")
    return f"{moment}Z"


def write_truth(path: Path, parameters: ShopParameters, ledger: Ledger) -> None:
    """Write ``truth.json``: parameters, working days, cycles, dirt with exact times and counts."""
    start = parameters.start
    kinds = sorted({g.kind for g in ledger.glitches})
    document = {
        "simulated": True,
        "machine": parameters.machine,
        "parameters": asdict(parameters),
        "days": ledger.days,
        "cycles": [_cycle(c, start, ledger.unobserved) for c in ledger.cycles],
        "heat": ledger.heat,
        "control": ledger.control,
        "drives": ledger.drives,
        "cutting": ledger.cutting,
        "thermocouples": ledger.thermocouples,
        "log": {
            "counts": {
                "glitches": {k: sum(g.kind == k for g in ledger.glitches) for k in kinds},
                "bursts": len(ledger.bursts),
                "late_lines": len(ledger.late_lines),
                "out_of_order": sum(f.out_of_order for f in ledger.log_files),
                "rejected": len(ledger.rejected),
                "lines": sum(f.lines for f in ledger.log_files),
            },
            "glitches": [asdict(g) for g in ledger.glitches],
            "bursts": [asdict(b) for b in ledger.bursts],
            "unobserved": [asdict(u) for u in ledger.unobserved],
            "late_lines": ledger.late_lines,
            "rejected": ledger.rejected,
            "files": [asdict(f) for f in ledger.log_files],
        },
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _cycle(cycle: Cycle, start: np.datetime64, unobserved: list[Unobserved]) -> dict[str, Any]:
    """A cycle as written; ``start_seen`` and ``end_seen`` say whether the log can show them."""
    row = asdict(cycle)
    row["start"], row["end"] = stamp(start, cycle.start), stamp(start, cycle.end)
    for edge in ("start", "end"):
        row[f"{edge}_seen"] = not any(u.start <= row[edge] <= u.end for u in unobserved)
    return row
