"""No-load power and specific cutting force of a machine from the load that its spindle shows."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.identification.cutting.spindle_load_cuts import cut_log, free_log, lines_unused
from pipeline.identification.cutting.spindle_load_lines import Lines, program_lines
from pipeline.identification.cutting.spindle_load_log import Readings, read_log
from pipeline.identification.cutting.spindle_load_records import LoadCut, SpindleLoadRecords
from pipeline.identification.cutting.spindle_power import SpecificForce, specific_force
from pipeline.identification.cutting.spindle_power_document import spindle_document
from pipeline.identification.cutting.spindle_power_levels import Levels
from pipeline.identification.cutting.spindle_power_log import LoadLog, load_levels
from pipeline.identification.cutting.spindle_power_no_load import NoLoad, no_load

FEWEST = 5
"""Readings of a level, below which its noise is not known."""
LISTED = 5
"""Lines that a note names."""


@dataclass(frozen=True, kw_only=True)
class _File:
    """A log that is to be read: its name, its entry in the manifest, what was cut meanwhile."""

    name: str
    entry: Mapping[str, Any]
    cut: LoadCut | None

    @property
    def sha256(self) -> str:
        return str(self.entry.get("sha256") or "")


def spindle_load(
    signals: Path, raw: Path, records: SpindleLoadRecords | None, widest: float
) -> dict[str, Any]:
    """What the spindle's load says: the part ``spindle`` of cutting.json.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote it.
    raw : Path
        The machine's folder with the programs.
    records : SpindleLoadRecords, optional
        Which logs; nothing is said without.
    widest : float
        Half of a 95 % interval wider than this share of its value is no determination.

    Raises
    ------
    ValueError
        When ``signals`` has no manifest, or a pattern fits none of its files.
    """
    if records is None:
        return {}
    used: list[_File] = []
    found: list[Levels] = []
    left_out: dict[str, str] = {}
    notes: list[str] = []
    reader = _Reader(signals=signals, raw=raw, records=records)
    for file in _files(signals, records):
        try:
            levels, note = reader.levels(file)
        except ValueError as error:
            left_out[file.name] = str(error)
            continue
        found.append(levels)
        used.append(file)
        notes += [note] if note else []
    reasons = [*left_out.values()]
    if not records.cuts:
        reasons.append("cutting_records.spindle.cuts names no program that cuts: log some that do")
    idle, force = _determined(found, reasons)
    document = spindle_document(
        idle, force, recordings=[one.name for one in used], widest=widest,
        reason="; ".join(reasons), assumed=records.scale.words, scale_error=records.scale_error,
    )  # fmt: skip
    return {
        **document,
        "left_out": [{"recording": name, "reason": why} for name, why in left_out.items()],
        "notes": notes,
        "found_from": {one.name: one.sha256 for one in used},
        "cuts": [] if idle is None else _cuts(_joined(found), idle),
    }


def _files(signals: Path, records: SpindleLoadRecords) -> list[_File]:
    """Logs that the records name, by no-load logs and cuts."""
    try:
        files = json.loads((signals / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{signals}/manifest.json cannot be read: run `dvc repro`") from error
    asked: list[tuple[str, str, LoadCut | None]] = [
        ("no_load", pattern, None) for pattern in records.no_load
    ]
    asked += [("cuts", cut.log, cut) for cut in records.cuts]
    found: dict[str, _File] = {}
    for part, pattern, cut in asked:
        named = [name for name in sorted(files) if fnmatchcase(name, pattern)]
        if not named:
            raise ValueError(
                f"no log in {signals} fits cutting_records.spindle.{part}, {pattern!r}: put the "
                "log there or correct the pattern"
            )
        for name in named:
            if name in found:
                raise ValueError(
                    f"log {name} fits two patterns of cutting_records.spindle, {pattern!r} is one: "
                    "let it fit one of them"
                )
            found[name] = _File(name=name, entry=files[name], cut=cut)
    return list(found.values())


@dataclass(frozen=True, kw_only=True)
class _Reader:
    """Reads logs; keeps the programs that it followed, and the first log of each content."""

    signals: Path
    raw: Path
    records: SpindleLoadRecords
    programs: dict[str, Lines] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)

    def levels(self, file: _File) -> tuple[Levels, str]:
        """Levels of a log, and what of it is of no use.

        Raises
        ------
        ValueError
            When nothing of it is.
        """
        output, records = file.entry.get("output"), self.records
        first = self.first.setdefault(file.sha256 or file.name, file.name)
        if first != file.name:
            raise ValueError(f"{file.name} is a copy of {first}: record another")
        if output is None:
            raise ValueError(f"{file.name} could not be read: {file.entry.get('reason')}")
        cuts = file.cut is not None
        log = read_log(self.signals / output, records.items, file.name, cuts=cuts)
        labelled, note = self._labelled(file, log)
        levels = load_levels(labelled, records.scale, settle_s=records.settle_s)
        kept = levels.where(
            (levels.samples >= FEWEST) & (levels.speed >= records.drive.minimum_speed)
        )
        if not len(kept):
            raise ValueError(
                f"{file.name} keeps no speed and cut for {records.settle_s:g} s and {FEWEST} "
                "readings more: hold them longer, or lower cutting_records.spindle.settle_s to "
                "five times the meter's lag"
            )
        return kept, note

    def _labelled(self, file: _File, log: Readings) -> tuple[LoadLog, str]:
        settle = self.records.settle_s
        if file.cut is None:
            return free_log(log, settle), ""
        program = file.cut.program
        if program not in self.programs:
            self.programs[program] = program_lines(self.raw, file.cut, self.records.setup)
        lines = self.programs[program]
        labelled = cut_log(log, lines, settle_s=settle, name=file.name, program=program)
        shortest = settle + FEWEST * log.period
        unused = lines_unused(log, lines, labelled, shortest)
        if not unused:
            return labelled, ""
        first = ", ".join(map(str, unused[:LISTED])) + (", …" if len(unused) > LISTED else "")
        return labelled, (
            f"{file.name}: {len(unused)} of {len(lines.stretches)} lines that cut are not used "
            f"(line {first}): one engagement and feed in them lasts less than {shortest:.2g} s, or "
            "they went otherwise than the program"
        )


def _joined(found: Sequence[Levels]) -> Levels:
    return Levels(
        **{
            item.name: np.concatenate([np.zeros(0), *(getattr(one, item.name) for one in found)])
            for item in fields(Levels)
        }
    )


def _determined(
    found: Sequence[Levels], reasons: list[str]
) -> tuple[NoLoad | None, SpecificForce | None]:
    """What the levels determine; adds to ``reasons`` why the rest is open."""
    together = _joined(found)
    idle = None
    try:
        idle = no_load(together)
        if (together.removal > 0.0).any() or not reasons:
            return idle, specific_force(together, idle)
    except ValueError as error:
        reasons.append(str(error))
    return idle, None


def _cuts(levels: Levels, idle: NoLoad) -> list[dict[str, float | int]]:
    """Each level of cutting, for people."""
    cuts = levels.where(levels.removal > 0.0)
    power = cuts.power - idle.power(cuts.speed)
    rows = zip(cuts.speed, cuts.removal, power, cuts.deviation, cuts.samples, strict=True)
    return [
        {
            "speed_rpm": _digits(60 * n),
            "removal_rate_cm3_min": _digits(60e6 * Q),
            "power_W": _digits(P),
            "deviation_W": _digits(s),
            "specific_force_N_mm2": _digits(P / Q * 1e-6),
            "samples": int(samples),
        }
        for n, Q, P, s, samples in rows
    ]


def _digits(value: float) -> float:
    return float(f"{value:.5g}")
