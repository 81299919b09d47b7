"""Identification of no-load power and specific cutting force from logs of a spindle's load."""

from collections.abc import Iterable, Mapping, Sequence
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


NO_LOAD_TERMS = (("p0", "WATT", 1.0), ("p1", "W s", 1.0), ("p2", "W s^2", 1.0))
"""Terms of the no-load power over the speed in rev/s: name, unit, SI value of one such unit."""
CUT_TERMS = (("K_tc", "N/mm^2", N_MM2), ("K_te", "N/mm", N_MM))
"""Terms of the cutting power likewise."""
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
    """Identified parameters by name, and the facts beside them."""

    parameters: Mapping[str, Parameter]
    facts: SpindleLoad


def identify_spindle_load(
    logs: Sequence[LoadLogFile], records: SpindleLoadRecords, widest: float
) -> SpindleLoadResult:
    """No-load power and specific force from logs; undetermined beyond the share ``widest``."""
    parts: dict[str, Levels] = {}
    left_out: dict[str, str] = {}
    notes: list[str] = []
    reader = _Reader(records=records)
    for log in logs:
        try:
            parts[log.name], note = reader.levels(log)
        except ValueError as error:
            left_out[log.name] = str(error)
            continue
        notes += [note] if note else []
    reasons = [*left_out.values()]
    if not records.cuts:
        reasons.append("cutting_records.spindle.cuts names no program that cuts: log some that do")
    levels = _joined(parts.values())
    idle, force = _identified(levels, reasons)
    facts = SpindleLoad(
        recordings=tuple(parts), reason="; ".join(reasons), assumed=records.scale.words,
        range_rpm=None if idle is None else (
            round(idle.lowest * MINUTE, 1), round(idle.highest * MINUTE, 1)
        ),
        curve=() if idle is None else _curve(idle, records.scale_error),
        cuts=() if idle is None else _cuts(levels, idle),
        left_out=tuple(LeftOut(case=name, reason=why) for name, why in left_out.items()),
        notes=tuple(notes),
    )  # fmt: skip
    parameters = power_parameters(idle, force, widest, records.scale_error)
    return SpindleLoadResult(parameters=parameters, facts=facts)


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


def _joined(parts: Iterable[Levels]) -> Levels:
    names = [field.name for field in fields(Levels)]
    return Levels(**{
        name: np.concatenate([np.zeros(0), *(getattr(one, name) for one in parts)])
        for name in names
    })  # fmt: skip


def _identified(levels: Levels, reasons: list[str]) -> tuple[NoLoad | None, SpecificForce | None]:
    """Results of the levels; adds to ``reasons`` why one is missing."""
    idle = None
    try:
        idle = no_load(levels)
        if (levels.removal > 0.0).any() or not reasons:
            return idle, specific_force(levels, idle)
    except ValueError as error:
        reasons.append(str(error))
    return idle, None


def _cuts(levels: Levels, idle: NoLoad) -> tuple[CutLevel, ...]:
    cuts = levels.where(levels.removal > 0.0)
    power = cuts.power - idle.power(cuts.speed)
    rows = zip(cuts.speed, cuts.removal, power, cuts.deviation, cuts.samples, strict=True)
    return tuple(
        CutLevel(
            speed_rpm=digits(60 * n), removal_rate_cm3_min=digits(60e6 * Q), power_W=digits(P),
            deviation_W=digits(s), specific_force_N_mm2=digits(P / Q * 1e-6), samples=int(samples),
        )
        for n, Q, P, s, samples in rows
    )  # fmt: skip


def _curve(idle: NoLoad, scale_error: float) -> tuple[NoLoadPoint, ...]:
    """Levels of the no-load power; those without an interval are left out."""
    return tuple(
        NoLoadPoint(
            speed_rpm=round(float(n) * MINUTE, 1), power_W=round(float(idle.power(n)), 2),
            half_width_95_W=round(float(np.hypot(half, scale_error * idle.power(n))), 2),
            measured_W=round(float(measured), 2),
        )
        for n, measured in zip(idle.levels.speed, idle.levels.power, strict=True)
        if np.isfinite(half := idle.half_width(n))
    )  # fmt: skip


def power_parameters(
    idle: NoLoad | None, force: SpecificForce | None, widest: float, scale_error: float = 0.0
) -> dict[str, Parameter]:
    """No-load power and specific force as they are stored.

    A 95 % interval whose half is beyond the share ``widest`` of the value leaves it undetermined.
    ``scale_error`` is half of the 95 % interval of the power that a load stands for, as a share
    [1]: all results scale with it, and their intervals hold it.
    """
    rows: dict[str, Parameter] = {}

    def add(name: str, unit: str, value: float, half: float, method: str, few: str = "") -> None:
        half = float(np.hypot(half, scale_error * value))
        finite = bool(np.isfinite(half) and np.isfinite(value))
        ends = f"{digits(value - half):g} to {digits(value + half):g}"
        rows[name] = Estimate(
            name=name, unit=unit, value=value, half_width=half, method=method,
            determined=finite and half <= widest * abs(value),
            reason=f"the 95 % interval, {ends}, is wider than asked" if finite else few,
            remedy="" if finite else "record more different ones",
        ).parameter  # fmt: skip

    def add_terms(fit: Regression, terms: Sequence[tuple[str, str, float]], method: str) -> None:
        few = "too few levels" if fit.freedom < 1 else "levels that do not tell it from the others"
        columns = zip(terms, fit.values, fit.half_width, strict=False)  # those that are determined
        for (name, unit, scale), value, half in columns:
            add(name, unit, float(value) / scale, float(half) / scale, method, few)

    if idle is not None:
        add_terms(idle.fit, NO_LOAD_TERMS, METHOD)
    if force is not None:
        levels = f"{force.cuts} levels of cutting"
        method = (
            f"power of {levels} over what they remove, each for the same time, edge force included"
        )
        add("specific_force", "N/mm^2", force.value / N_MM2, force.half_width / N_MM2, method)
        method = f"least squares on {levels}, no-load power taken off"
        add_terms(force.fit, CUT_TERMS, method)
    return rows
