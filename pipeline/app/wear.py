"""Wear of the tools in recordings by the champion's model, with its 90 % interval.

Conditions that lie outside of the training data are refused by name.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.fleet import DATA, ingest_files, machine_parameters
from pipeline.app.output import label
from pipeline.app.programs import CHAMPION, model_folder, model_lines, passed_status, stored_model
from pipeline.parameters import structure
from pipeline.signals.conditions import Condition
from pipeline.signals.wear_lives import ConditionRows, read_lives
from pipeline.signals.wear_windows import WearRecords, WearWindows
from pipeline.submodels.wear.model import NAMES, Wear, WearModel, load_wear
from pipeline.submodels.wear.submodel import SUBMODEL

SHOWN = 12
"""Readings of one recording on the screen at most."""
SLACK = 1e-6
"""Relative distance [1] up to which a condition counts as one that was learnt."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Wear at one place of a recording."""

    recording: str
    """Name of the recording, and that of the part of a table."""
    time_s: float
    """Time since the recording began [s]."""
    use: float | None
    """Use of the tool, in the unit of the model; None where it is not known."""
    wear: float
    low: float | None
    high: float | None
    """Wear in the unit of the model, and the ends of the 90 % interval; None for a class."""


@dataclass(frozen=True, kw_only=True)
class WearReadings:
    """Wear of recordings, with what it rests on."""

    machine: str
    origin: str
    """Machine, and origin of the records of the training."""
    model: str
    """Model used: ``champion`` or ``latest``."""
    status: str
    """Status of the model's verdict."""
    quantity: str
    unit: str
    use_unit: str
    """Quantity that is estimated, and the unit of the tool's use."""
    method: str
    """Method that serves, by its name for a person."""
    notes: tuple[str, ...] = ()
    """Limits of the readings, a sentence each."""
    readings: tuple[Reading, ...]
    """Readings in the order of recordings and time."""


def wear_of_files(
    files: Sequence[Path], machine: str, model: str = CHAMPION,
    given: Sequence[str] = (), *, anyway: bool = False,
) -> WearReadings:  # fmt: skip
    """Wear of the tools in ``files``.

    ``given``: conditions as ``name=value``, numbers in the unit of section ``wear_records``;
    ``anyway``: even when the model failed or was not judged.
    """
    parameters = machine_parameters(machine)
    own = parameters["machine"][machine]
    if "wear_records" not in own:
        raise ValueError(
            f"conf/machine/{machine}.yaml has no section wear_records: {machine} needs "
            f"{SUBMODEL.needs}"
        )
    records = structure(own, "wear_records", WearRecords)
    folder = stored_model(machine, model, SUBMODEL)
    status = passed_status(folder, "wear model", anyway=anyway)
    wear, unknown = load_wear(folder), SUBMODEL.unknown_columns(folder)
    conditions = _given(given, records)
    with tempfile.TemporaryDirectory() as scratch:
        signals = Path(scratch) / "signals"
        for one in ingest_files(files, machine, signals, lambda name: None):
            if one.reason:
                raise ValueError(f"{one.path}: {one.reason}")
        beside = _beside(machine, records)
        found = read_lives(
            signals, replace(records, recordings=("*",), table=None, most=None), known=False,
            given=lambda name: {**beside(name), **conditions},
        )  # fmt: skip
    if found.left_out:
        name, reason = next(iter(found.left_out.items()))
        raise ValueError(f"{name}: {reason}")
    readings: list[Reading] = []
    methods, notes = [], []
    for life in found.lives:
        _refuse_unlearnt(life.windows, wear.file)
        notes += _notes(life.tool, life.windows, wear.file)
        method, some = _readings(life.windows, wear)
        methods.append(NAMES[method])
        readings += [replace(one, low=None, high=None) for one in some] if unknown else some
    notes += dict.fromkeys(unknown.values())
    return WearReadings(
        machine=machine, origin=wear.file.origin, model=model, status=status,
        quantity=wear.file.quantity, unit=wear.file.wear_unit, use_unit=wear.file.progress_unit,
        method=", ".join(dict.fromkeys(methods)), readings=tuple(readings), notes=tuple(notes),
    )  # fmt: skip


def _given(given: Sequence[str], records: WearRecords) -> dict[str, Condition]:
    words = {*records.discrete, *([records.tool] if records.tool else [])}
    known = [*records.continuous, *sorted(words)]
    found = {}
    for one in given:
        name, sign, value = one.partition("=")
        if not sign or name not in known:
            raise ValueError(
                f"--set {one} is no condition of the machine: give name=value of "
                f"{', '.join(known) or 'none'}"
            )
        if name in words:
            found[name] = Condition(value=value, source="--set")
            continue
        try:
            number = float(value)
        except ValueError as error:
            raise ValueError(
                f"--set {one} is no number: give it in {records.continuous[name]}"
            ) from error
        found[name] = Condition(value=number, unit=records.continuous[name], source="--set")
    return found


def _beside(machine: str, records: WearRecords) -> Any:
    """Conditions of a file by its name, from the machine's table of recordings where it has one."""
    signals, table = DATA / "signals" / machine, records.table
    if table is None or not (signals / "manifest.json").exists():
        return lambda name: {}
    rows = ConditionRows.read(signals, table)
    folder = table.file.rpartition("/")[0]
    wanted = {*records.continuous, *records.discrete, records.tool}

    def conditions(name: str) -> dict[str, Condition]:
        try:
            row = rows.row(f"{folder}/{name}" if folder else name)
        except ValueError:  # a new recording
            return {}
        return {key: one for key, one in row.items() if key in wanted}

    return conditions


def _refuse_unlearnt(windows: WearWindows, file: WearModel) -> None:
    name = str(windows.recording[0])
    for key, values in windows.conditions.items():
        learnt = file.conditions.get(key)
        needed = key in file.known.numbers or key in file.known.words
        if learnt is None or key == file.progress:
            continue
        if learnt.words:
            told = set(values.tolist()) - {""}
            words = ", ".join(learnt.words)
            if needed and "" in values.tolist():
                raise ValueError(f"{name}: its {key} is not known: add --set {key}=… of {words}")
            if strange := sorted(told - set(learnt.words)):
                raise ValueError(f"{name}: its {key} is {strange[0]}, {words} were learnt")
            continue
        low, high = learnt.low or 0.0, learnt.high or 0.0
        learnt_words = f"{low:g} to {high:g} {learnt.unit} were learnt"
        numbers = np.asarray(values, float)
        if needed and not np.isfinite(numbers).all():
            raise ValueError(
                f"{name}: its {key} is not known: add --set {key}=… in {learnt.unit}; "
                f"{learnt_words}"
            )
        slack = SLACK * max(abs(low), abs(high))
        outside = numbers[(numbers < low - slack) | (numbers > high + slack)]
        if len(outside):
            raise ValueError(f"{name}: its {key} is {outside[0]:g} {learnt.unit}, {learnt_words}")


def _notes(tool: str, windows: WearWindows, file: WearModel) -> list[str]:
    if file.is_class:
        return []
    use = np.asarray(windows.progress, float)
    learnt = file.conditions.get(file.progress)
    if not np.isfinite(use).all():
        missing = f"; --set {file.progress}=… tells it" if file.progress else ""
        return [f"{tool}: the use of the tool is not known, so that signals alone serve{missing}"]
    if learnt is not None and learnt.high is not None and use.max() > learnt.high * (1 + SLACK):
        return [
            f"{tool}: its {file.progress} of {use.max():g} {learnt.unit} is beyond the "
            f"{learnt.high:g} {learnt.unit} of every training tool"
        ]
    return []


def _readings(windows: WearWindows, wear: Wear) -> tuple[str, list[Reading]]:
    places, found = wear.predict(windows)
    method, told, low, high = wear.served(found)
    use = np.asarray(windows.progress, float)
    return method, [
        Reading(
            recording=str(windows.recording[first]), time_s=float(windows.time[first]),
            use=_known(use[first]), wear=float(told[k]), low=_known(low[k]), high=_known(high[k]),
        )
        for k, first in enumerate(places.first)
    ]  # fmt: skip


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def said(wear: WearReadings) -> Iterator[str]:
    """Report of ``kerf wear`` in lines."""
    head = f"{wear.machine}{label(wear.origin)}: {wear.quantity} by {wear.method}"
    yield from model_lines(head, model_folder(wear.machine, wear.model), wear.status, "wear model")
    yield from wear.notes
    by_recording: dict[str, list[Reading]] = {}
    for one in wear.readings:
        by_recording.setdefault(one.recording, []).append(one)
    width = max(map(len, by_recording), default=0)
    is_class = wear.unit == "1"
    ends_known = any(one.low is not None for one in wear.readings)
    head = f"{'worn, 1' if is_class else 'VB, um':>8}"
    head += "  90 % interval, um" if ends_known else ""
    yield f"{'recording':<{width}}  {'time, s':>9}  {head}"
    for name, some in by_recording.items():
        places = np.unique(np.linspace(0, len(some) - 1, min(SHOWN, len(some))).round().astype(int))
        for k in places.tolist():
            one = some[k]
            value = f"{one.wear:8.2f}" if is_class else f"{one.wear:8.0f}"
            ends = (
                "" if one.low is None or one.high is None else f"  {one.low:.0f} to {one.high:.0f}"
            )
            yield f"{name:<{width}}  {max(one.time_s, 0.0):9.2f}  {value}{ends}"
        if len(some) > SHOWN:
            mean = float(np.mean([one.wear for one in some]))
            yield f"{name}: {len(places)} of {len(some)} windows shown, mean {mean:.3g} {wear.unit}"
