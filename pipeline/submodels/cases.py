"""Cases: records as a sub-model sees them, each with its role, conditions and raw files.

The role of a case is decided here and nowhere else: by section ``roles`` of the machine's file and
by the frozen sets in ``data/golden/<machine>.json``.  Leaks, raw bytes that a model was fitted on,
and frozen files that have changed are told here too.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pipeline.schema.days import day_of_text, is_day
from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.schema.model import Condition, LeftOut, Model, SourceFile, Training
from pipeline.schema.verdict import Fact, GoldenUsed, Role
from pipeline.signals.conditions import selection, share_rows

ENDS = ("first", "last")
"""Times of a raw file in the ingest's manifest: of its first and its last record."""


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Selection of the training records; all others are left out of every fit."""

    training: tuple[str, ...] = ()
    """Patterns of raw files below the machine's folder."""
    training_days: Days | None = None
    """Days of the plant, for files that have a clock."""

    def is_training(self, file: str) -> bool:
        """Whether a raw file matches one of the patterns."""
        return any(fnmatchcase(file, pattern) for pattern in self.training)


@dataclass(frozen=True, kw_only=True)
class Records:
    """Folders and files of one machine; a sub-model names those that it reads, others are None.

    ``drive`` is the folder of the identified drives, ``wear`` that of the wear model, for what
    builds on them; it holds no ``model.json`` where a machine has none.
    """

    raw: Path | None = None
    signals: Path | None = None
    clean: Path | None = None
    manifest: Path | None = None
    drive: Path | None = None
    wear: Path | None = None

    @classmethod
    def of_machine(
        cls, data: Path, machine: str, models: Path, under: Path | None = None
    ) -> "Records":
        """All records of a machine below ``data``, with the models that others build on.

        ``models``: folder of the machine's sub-models; ``under``: folder of the drives where that
        one holds none.
        """
        signals, drive = data / "signals" / machine, models / "drive"
        if under is not None and not (drive / "model.json").exists():
            drive = under
        return cls(
            raw=data / "raw" / machine, signals=signals, clean=data / "clean" / machine,
            manifest=signals / "manifest.json", drive=drive, wear=models / "wear",
        )  # fmt: skip

    @property
    def files(self) -> Mapping[str, Mapping[str, Any]]:
        """Manifest of the raw files: ``sha256``, ``first``, ``last``, …; ValueError without one."""
        if self.manifest is not None:
            path = self.manifest
        elif self.signals is not None:
            path = self.signals / "manifest.json"
        else:
            raise ValueError("a sub-model needs the signals or their manifest: name them in reads")
        try:
            found: Mapping[str, Mapping[str, Any]] = json.loads(path.read_text())["files"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{path} is no manifest: run `dvc repro ingest`") from error
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Record of a quantity that can be predicted."""

    name: str
    """Name of the recording, run or day."""
    group: str
    """Group that stays together in splits and in the bootstrap: a day, a recording, a tool."""
    role: Role
    """Role of the case."""
    files: tuple[SourceFile, ...]
    """Raw files, with the hashes of their bytes."""
    load: Callable[[], Any]
    """Its content, in the sub-model's own type."""
    conditions: Mapping[str, Fact] = field(default_factory=dict)
    """Recording conditions: numbers with units, words."""

    @property
    def training(self) -> Training:
        """Text of the model's file on a training case."""
        return Training(case=self.name, group=self.group, files=self.files)


def held(content: Any) -> Callable[[], Any]:
    """Content that is in memory, as a case loads it."""
    return lambda: content


@dataclass(frozen=True, kw_only=True)
class Cases:
    """Cases of a sub-model, and records that are none, with the reason.

    ``absent`` has the data items that the machine's file names and no record has, each with those
    that are called like it.
    """

    cases: tuple[Case, ...]
    left_out: tuple[LeftOut, ...] = ()
    absent: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def of(self, *roles: Role) -> tuple[Case, ...]:
        """Cases of some roles."""
        return tuple(case for case in self.cases if case.role in roles)


def nights(cases: Cases) -> dict[str, tuple[Case, ...]]:
    """Held-out cases that are days of the plant after the last training day, the oldest first.

    Such cases are continuous records of 24 hours; there is none where a case is a recording.
    Golden and sealed days are none either: a day that is looked at each night is learnt.
    """
    learnt = max((case.name for case in cases.of("training") if is_day(case.name)), default="")
    days = {c.name for c in cases.of("held_out") if is_day(c.name) and c.name > learnt}
    return {day: tuple(c for c in cases.of("held_out") if c.name == day) for day in sorted(days)}


def newest_day(cases: Cases) -> tuple[Case, ...]:
    """Cases of the newest 24 hours in :func:`nights`; empty where records are not continuous."""
    found = nights(cases)
    return found[max(found)] if found else ()


def role_of(
    files: Sequence[str], roles: Roles, sets: GoldenSets | None = None, day: str = ""
) -> Role:
    """Role of a case that was recorded in ``files``, and on ``day`` where they have a clock.

    A frozen set goes before training: a record that is in both is judged by, and the overlap is
    found by the hash of its bytes.  A case belongs to a frozen set when its day is among the days
    that count, or one of its files, or of its parts of files, was frozen as a whole.
    """
    if sets is not None:
        if _in_set(files, sets.sealed, day):
            return "sealed"
        if _in_set(files, sets.golden, day):
            return "golden"
    if day and roles.training_days is not None:
        return "training" if day in roles.training_days else "held_out"
    if any(roles.is_training(file) for file in files):
        return "training"
    return "held_out"


def _in_set(files: Sequence[str], frozen: FrozenSet | None, day: str) -> bool:
    if frozen is None:
        return False
    names = [one.file for one in frozen.files]
    if day and frozen.days is not None:
        if day in frozen.days:
            return True
        names = list(frozen.whole)
    parted = {file for name in files if (file := selection(name)[0]) != name}
    own = [name for name in files if name not in parted]
    return any(share_rows(name, other) for name in own for other in names)


def learnt_from(frozen: FrozenSet, case: Training) -> tuple[SourceFile, SourceFile] | None:
    """A frozen file and the file of a case with the same bytes; None where there is none.

    Days of a log beside those that count are no such case of it.
    """
    hashes = {one.sha256: one for one in frozen.files}
    for file in case.files:
        one = hashes.get(file.sha256)
        if one is None or (
            one.file == file.file
            and one.file not in frozen.whole
            and frozen.days is not None
            and is_day(case.case)
            and case.case not in frozen.days
        ):
            continue
        return one, file
    return None


def held_back(cases: Cases, sets: GoldenSets | None) -> Cases:
    """Cases without those of training whose bytes are frozen, under whatever name."""
    kept, left = [], []
    for case in cases.cases:
        found = None
        if sets is not None and case.role == "training":
            found = next(
                (pair for one in (sets.golden, sets.sealed) if one is not None
                 if (pair := learnt_from(one, case.training)) is not None), None,
            )  # fmt: skip
        if found is None:
            kept.append(case)
            continue
        frozen, file = found
        reason = f"{file.file} has the same bytes as {frozen.file}, which is frozen: record another"
        left.append(LeftOut(case=case.name, reason=reason))
    return replace(cases, cases=tuple(kept), left_out=(*cases.left_out, *left))


def sources(files: Mapping[str, Mapping[str, Any]], names: Iterable[str]) -> tuple[SourceFile, ...]:
    """Raw files, or parts of them, by name, with the hashes that the manifest has of the files."""
    return tuple(
        SourceFile(file=name, sha256=str(files[selection(name)[0]]["sha256"])) for name in names
    )


def files_of_day(files: Mapping[str, Mapping[str, Any]], day: str, zone: str) -> list[str]:
    """Raw files of one day of the plant, see :func:`files_of_days`."""
    return files_of_days(files, Days(first=day, last=day), zone)


def files_of_days(files: Mapping[str, Mapping[str, Any]], days: Days, zone: str) -> list[str]:
    """Raw files whose last record is of some days of the plant, which has a time zone.

    A log restates at its start what was known before, so that its first time says little.  Where no
    file ends in these days, as of a log that is one file for weeks, it is those that reach over
    them.
    """
    spans = {
        name: tuple(day_of_text(str(entry[end]), zone) if entry.get(end) else "" for end in ENDS)
        for name, entry in sorted(files.items())
    }
    ending = [name for name, (_, last) in spans.items() if last in days]
    over = [name for name, (first, last) in spans.items() if first and first <= days.last < last]
    return ending or over


def conditions_of(cases: Iterable[Case]) -> dict[str, Condition]:
    """Range of each condition over cases: numbers from low to high, words as a list."""
    found: dict[str, Condition] = {}
    for case in cases:
        for name, fact in case.conditions.items():
            if fact.value is None:
                continue
            before = found.get(name, Condition(unit=fact.unit))
            if isinstance(fact.value, str):
                words = tuple(sorted({*before.words, fact.value}))
                found[name] = Condition(unit=fact.unit, words=words)
            else:
                low = fact.value if before.low is None else min(before.low, fact.value)
                high = fact.value if before.high is None else max(before.high, fact.value)
                found[name] = Condition(unit=fact.unit, low=low, high=high)
    return found


def leak_reasons(model: Model, cases: Iterable[Case]) -> list[str]:
    """Cases to judge by whose raw bytes the model was fitted on, under whatever name."""
    fitted: dict[str, list[tuple[str, str]]] = {}
    for trained in model.trained_on:
        for one in trained.files:
            fitted.setdefault(one.sha256, []).append((trained.case, one.file))
    found = []
    for case in cases:
        for one in case.files:
            seen = [
                file for name, file in fitted.get(one.sha256, ())
                if not (file == one.file and name != case.name and is_day(name))
            ]  # fmt: skip
            if seen:  # another day of the same log is none
                found.append(
                    f"{case.name}: {one.file} has the same bytes as {seen[0]}, which the model "
                    "was fitted on"
                )
    return found


def set_reasons(
    model: Model, sets: GoldenSets | None, files: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    """Defects of the frozen sets themselves."""
    if sets is None:
        return []
    found = []
    if sets.machine != model.machine:
        found.append(f"the golden set is one of {sets.machine}, not of {model.machine}")
    for what, frozen in (("golden", sets.golden), ("sealed", sets.sealed)):
        if frozen is None:
            continue
        found += changes(frozen, files, what)
        seen = dict(p for one in model.trained_on if (p := learnt_from(frozen, one)) is not None)
        found += [
            f"{one.file} of the {what} set has the same bytes as {file.file}, which the model was "
            "fitted on"
            for one, file in seen.items()
        ]
    return found


def changes(
    frozen: FrozenSet, files: Mapping[str, Mapping[str, Any]], what: str = "golden"
) -> list[str]:
    """Sentence for each file of a frozen set that has changed since.

    A file that reaches into its days and was not frozen changes the set as much as one that is
    not what it was.
    """
    found = []
    for one in frozen.files:
        entry = files.get(selection(one.file)[0])
        if entry is None:
            found.append(f"{one.file} of the {what} set is not among the records")
        elif entry["sha256"] != one.sha256:
            found.append(
                f"{one.file} of the {what} set has sha256 {str(entry['sha256'])[:12]}, "
                f"frozen was {one.sha256[:12]}"
            )
    if frozen.days is not None:
        known = {one.file for one in frozen.files}
        found += [
            f"{name} reaches into the days of the {what} set and was not frozen with it"
            for name, entry in sorted(files.items())
            if name not in known
            and entry.get("last")
            and day_of_text(str(entry["last"]), frozen.time_zone) in frozen.days
        ]
    return found


def golden_used(frozen: FrozenSet | None) -> GoldenUsed | None:
    """Summary of the golden set that a verdict rests on."""
    if frozen is None:
        return None
    days = frozen.days
    return GoldenUsed(
        sha256=frozen.sha256, files=len(frozen.files),
        first="" if days is None else days.first, last="" if days is None else days.last,
    )  # fmt: skip
