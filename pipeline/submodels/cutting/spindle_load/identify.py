"""Identification of no-load power and specific cutting force from logs of a spindle's load."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.cutting.force.force_law import N_MM, N_MM2
from pipeline.schema.cutting import CutLevel, NoLoadPoint, SpindleLoad
from pipeline.schema.model import LeftOut, Parameter
from pipeline.schema.si import MINUTE
from pipeline.submodels.cutting.regression import Estimate, Regression, digits
from pipeline.submodels.cutting.settings import LoadCut, SpindleLoadRecords
from pipeline.submodels.cutting.spindle_load.levels import (
    Levels,
    LoadLog,
    NoLoad,
    SpecificForce,
    load_levels,
    no_load,
    specific_force,
)
from pipeline.submodels.cutting.spindle_load.readings import (
    Lines,
    Readings,
    cut_log,
    no_load_log,
    program_lines,
    read_log,
    unused_lines,
)

FEWEST = 5
"""Readings of a level, at least, for its noise."""
LISTED = 5
"""Lines that a note lists, at most."""


UNITS = ("WATT", "W s", "W s^2")
"""Units of the terms of the no-load power, over the speed in rev/s."""
NAMES = ("p0", "p1", "p2")
"""Names of these terms."""
METHOD = "least squares on levels of constant speed; noise and rounding of the display counted"


@dataclass(frozen=True, kw_only=True)
class LoadLogFile:
    """Log to be read: its name, its entry in the manifest, the program that cut meanwhile."""

    name: str
    entry: Mapping[str, Any]
    cut: LoadCut | None
    signals: Path
    raw: Path
    """Folders of the log, as ``ingest`` wrote it, and of the program."""

    @property
    def sha256(self) -> str:
        """SHA-256 of the raw file."""
        return str(self.entry.get("sha256") or "")


@dataclass(frozen=True, kw_only=True)
class SpindleLoadResult:
    """Identified parameters by name, the facts beside them, and the logs that were used."""

    parameters: Mapping[str, Parameter]
    facts: SpindleLoad
    used: tuple[str, ...]


def identify_spindle_load(
    logs: Sequence[LoadLogFile], records: SpindleLoadRecords, widest: float
) -> SpindleLoadResult:
    """No-load power and specific force from logs; undetermined beyond the share ``widest``."""
    used: list[str] = []
    parts: list[Levels] = []
    left_out: dict[str, str] = {}
    notes: list[str] = []
    reader = _Reader(records=records)
    for log in logs:
        try:
            levels, note = reader.levels(log)
        except ValueError as error:
            left_out[log.name] = str(error)
            continue
        parts.append(levels)
        used.append(log.name)
        notes += [note] if note else []
    reasons = [*left_out.values()]
    if not records.cuts:
        reasons.append("cutting_records.spindle.cuts names no program that cuts: log some that do")
    idle, force = _identified(parts, reasons)
    facts = SpindleLoad(
        recordings=tuple(used),
        reason="; ".join(reasons),
        assumed=records.scale.words,
        range_rpm=None if idle is None else _range(idle),
        curve=() if idle is None else _curve(idle, records.scale_error),
        cuts=() if idle is None else _cuts(_joined(parts), idle),
        left_out=tuple(LeftOut(case=name, reason=why) for name, why in left_out.items()),
        notes=tuple(notes),
    )
    parameters = power_parameters(idle, force, widest, records.scale_error)
    return SpindleLoadResult(parameters=parameters, facts=facts, used=tuple(used))


def load_logs(
    files: Mapping[str, Mapping[str, Any]], records: SpindleLoadRecords, signals: Path, raw: Path
) -> list[LoadLogFile]:
    """Logs that the records name: no-load logs, then those of cuts.

    ``files`` are the entries of the manifest by raw file. ValueError when a pattern fits none of
    the files, or a log fits two patterns.
    """
    patterns: list[tuple[str, str, LoadCut | None]] = [
        ("no_load", pattern, None) for pattern in records.no_load
    ]
    patterns += [("cuts", cut.log, cut) for cut in records.cuts]
    by_name: dict[str, LoadLogFile] = {}
    for section, pattern, cut in patterns:
        named = [name for name in sorted(files) if fnmatchcase(name, pattern)]
        if not named:
            raise ValueError(
                f"no log fits cutting_records.spindle.{section}, {pattern!r}: put the log into the "
                "machine's folder or correct the pattern"
            )
        for name in named:
            if name in by_name:
                raise ValueError(
                    f"log {name} fits two patterns of cutting_records.spindle, {pattern!r} is one: "
                    "let it fit one of them"
                )
            by_name[name] = LoadLogFile(
                name=name, entry=files[name], cut=cut, signals=signals, raw=raw
            )
    return list(by_name.values())


@dataclass(frozen=True, kw_only=True)
class _Reader:
    """Reader of logs; keeps the programs it has followed, and the first log of each content."""

    records: SpindleLoadRecords
    programs: dict[str, Lines] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)

    def levels(self, file: LoadLogFile) -> tuple[Levels, str]:
        """Levels of a log, and a note on the unused part; ValueError where no part can be used."""
        output, records = file.entry.get("output"), self.records
        first = self.first.setdefault(file.sha256 or file.name, file.name)
        if first != file.name:
            raise ValueError(f"{file.name} is a copy of {first}: record another")
        if output is None:
            raise ValueError(f"{file.name} could not be read: {file.entry.get('reason')}")
        cuts = file.cut is not None
        log = read_log(file.signals / output, records.items, file.name, cuts=cuts)
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

    def _labelled(self, file: LoadLogFile, log: Readings) -> tuple[LoadLog, str]:
        settle = self.records.settle_s
        if file.cut is None:
            return no_load_log(log, settle), ""
        program = file.cut.program
        if program not in self.programs:
            self.programs[program] = program_lines(file.raw, file.cut, self.records.setup)
        lines = self.programs[program]
        labelled = cut_log(log, lines, settle_s=settle, name=file.name, program=program)
        shortest = settle + FEWEST * log.period
        unused = unused_lines(log, lines, labelled, shortest)
        if not unused:
            return labelled, ""
        first = ", ".join(map(str, unused[:LISTED])) + (", …" if len(unused) > LISTED else "")
        return labelled, (
            f"{file.name}: {len(unused)} of {len(lines.stretches)} lines that cut are not used "
            f"(line {first}): one engagement and feed in them lasts less than {shortest:.2g} s, or "
            "they went otherwise than the program"
        )


def _joined(parts: Sequence[Levels]) -> Levels:
    return Levels(
        **{
            item.name: np.concatenate([np.zeros(0), *(getattr(one, item.name) for one in parts)])
            for item in fields(Levels)
        }
    )


def _identified(
    parts: Sequence[Levels], reasons: list[str]
) -> tuple[NoLoad | None, SpecificForce | None]:
    """Results of the levels; adds to ``reasons`` why one is missing."""
    together = _joined(parts)
    idle = None
    try:
        idle = no_load(together)
        if (together.removal > 0.0).any() or not reasons:
            return idle, specific_force(together, idle)
    except ValueError as error:
        reasons.append(str(error))
    return idle, None


def _cuts(levels: Levels, idle: NoLoad) -> tuple[CutLevel, ...]:
    cuts = levels.where(levels.removal > 0.0)
    power = cuts.power - idle.power(cuts.speed)
    rows = zip(cuts.speed, cuts.removal, power, cuts.deviation, cuts.samples, strict=True)
    return tuple(
        CutLevel(
            speed_rpm=digits(60 * n),
            removal_rate_cm3_min=digits(60e6 * Q),
            power_W=digits(P),
            deviation_W=digits(s),
            specific_force_N_mm2=digits(P / Q * 1e-6),
            samples=int(samples),
        )
        for n, Q, P, s, samples in rows
    )


def _range(idle: NoLoad) -> tuple[float, float]:
    """Speeds between which the no-load power holds [rev/min]."""
    return round(idle.lowest * MINUTE, 1), round(idle.highest * MINUTE, 1)


def _curve(idle: NoLoad, scale_error: float) -> tuple[NoLoadPoint, ...]:
    """Levels of the no-load power; those without an interval are left out."""
    return tuple(
        NoLoadPoint(
            speed_rpm=round(float(n) * MINUTE, 1),
            power_W=round(float(idle.power(n)), 2),
            half_width_95_W=round(
                float(np.hypot(idle.half_width(n), scale_error * idle.power(n))), 2
            ),
            measured_W=round(float(measured), 2),
        )
        for n, measured in zip(idle.levels.speed, idle.levels.power, strict=True)
        if np.isfinite(idle.half_width(n))
    )


def power_parameters(
    idle: NoLoad | None, force: SpecificForce | None, widest: float, scale_error: float = 0.0
) -> dict[str, Parameter]:
    """No-load power and specific force as they are stored.

    A 95 % interval whose half is beyond the share ``widest`` of the value leaves it undetermined.
    ``scale_error`` is half of the 95 % interval of the power that a load stands for, as a share
    [1]: all results scale with it, and their intervals hold it.
    """
    rows: list[Estimate] = []
    if idle is not None:
        rows += [
            _fitted(NAMES[k], idle.fit, k, unit=UNITS[k], widest=widest, method=METHOD,
                    scale_error=scale_error)
            for k in range(len(idle.fit.values))
        ]  # fmt: skip
    if force is not None:
        method = (
            f"power of {force.cuts} levels of cutting over what they remove, each for the same "
            "time, edge force included"
        )
        half = float(np.hypot(force.half_width, scale_error * force.value))
        rows.append(
            _estimate("specific_force", force.value / N_MM2, half / N_MM2, unit="N/mm^2",
                      widest=widest, method=method)
        )  # fmt: skip
        method = f"least squares on {force.cuts} levels of cutting, no-load power taken off"
        terms = (("K_tc", N_MM2, "N/mm^2"), ("K_te", N_MM, "N/mm"))
        rows += [
            _fitted(name, force.fit, k, unit=unit, widest=widest, method=method, scale=scale,
                    scale_error=scale_error)
            for k, (name, scale, unit) in enumerate(terms[: len(force.fit.values)])
        ]  # fmt: skip
    return {one.name: one.parameter for one in rows}


def _fitted(
    name: str, fit: Regression, index: int, *, unit: str, widest: float, method: str,
    scale: float = 1.0, scale_error: float = 0.0,
) -> Estimate:  # fmt: skip
    value, half = float(fit.values[index]), float(fit.half_width[index])
    what = "too few levels" if fit.freedom < 1 else "levels that do not tell it from the others"
    return _estimate(
        name, value / scale, float(np.hypot(half, scale_error * value)) / scale, unit=unit,
        widest=widest, method=method, missing=what,
    )  # fmt: skip


def _estimate(
    name: str, value: float, half: float, *, unit: str, widest: float, method: str,
    missing: str = "",
) -> Estimate:  # fmt: skip
    finite = bool(np.isfinite(half) and np.isfinite(value))
    wide = f"the 95 % interval, {digits(value - half):g} to {digits(value + half):g}"
    return Estimate(
        name=name, unit=unit, value=value, half_width=half, method=method,
        determined=finite and half <= widest * abs(value),
        reason=f"{wide}, is wider than asked" if finite else missing,
        remedy="" if finite else "record more different ones",
    )  # fmt: skip
