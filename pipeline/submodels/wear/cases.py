"""Lives of tools as cases: roles, conditions, copied windows; and windows of a table of samples."""

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.schema.arrays import Ints
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import LeftOut, SourceFile
from pipeline.schema.verdict import Fact, Role
from pipeline.signals.wear_lives import read_lives
from pipeline.signals.wear_windows import ToolLife, WearRecords, WearWindows
from pipeline.submodels.cases import Case, Cases, Roles, role_of
from pipeline.submodels.wear.model import WearModel

if TYPE_CHECKING:
    import pandas as pd


def life_cases(
    signals: Path, records: WearRecords, roles: Roles, sets: GoldenSets | None,
    in_use: Collection[str] = (),
) -> Cases:  # fmt: skip
    """Lives of a machine's tools.

    A tool is in training as soon as one of its recordings is, so that none is learnt from and
    judged on.  A window of another life with the samples of one in training makes the case name the
    training recording among its files: the judge then refuses it as seen.  Of tools ``in_use`` the
    recordings after the last measurement of their wear are kept, with NaN.
    """
    found = read_lives(signals, records, roles.is_training, in_use=in_use)
    by_role: list[tuple[ToolLife, Role]] = [
        (life, role_of(_names(life), roles, sets)) for life in found.lives
    ]
    training = [life for life, role in by_role if role == "training"]
    learnt = {
        digest: life.files[_file_of(life, k)].sha256
        for life in training
        for k, digest in enumerate(life.windows.sha256s())
    }
    cases = []
    for life, role in by_role:
        files = [SourceFile(file=one.file, sha256=one.sha256) for one in life.files]
        if role != "training":
            files += _copied(life, learnt)
        conditions = {} if role == "sealed" else _conditions(life, training)
        cases.append(
            Case(
                name=life.tool, group=life.tool, role=role, files=tuple(files),
                load=_constant(life.windows), conditions=conditions,
            )
        )  # fmt: skip
    left_out = [LeftOut(case=name, reason=reason) for name, reason in found.left_out.items()]
    return Cases(cases=tuple(cases), left_out=tuple(left_out))


def _names(life: ToolLife) -> list[str]:
    """Names by which a life may be given a role: those of its recordings and raw files."""
    return [*dict.fromkeys(n for one in life.files for n in (one.name, one.file)), life.tool]


def _file_of(life: ToolLife, window: int) -> int:
    names = [one.name for one in life.files]
    return names.index(str(life.windows.recording[window]))


def _copied(life: ToolLife, learnt: dict[str, str]) -> list[SourceFile]:
    """Training recordings of which a window stands in this life, and that copy."""
    seen: dict[str, SourceFile] = {}
    for k, digest in enumerate(life.windows.sha256s()):
        if (source := learnt.get(digest)) is not None:
            name = f"{life.windows.recording[k]}, window at {life.windows.time[k]:.4g} s,"
            seen.setdefault(source, SourceFile(file=name, sha256=source))
    return list(seen.values())


def _conditions(life: ToolLife, training: list[ToolLife]) -> dict[str, Fact]:
    """Value of each condition, of the life that lies furthest from what training lives have."""
    found = {}
    for name, values in life.windows.conditions.items():
        others = [one.windows.conditions[name] for one in training]
        if name in life.windows.condition_units:
            numbers = [np.asarray(one, float) for one in others]
            low = min((float(one.min()) for one in numbers), default=-np.inf)
            high = max((float(one.max()) for one in numbers), default=np.inf)
            beyond = np.maximum(low - values, values - high)
            furthest = float(values[int(np.argmax(beyond))])
            value = float(f"{furthest:.6g}")
            if np.isfinite(value):
                found[name] = Fact(value=value, unit=life.windows.condition_units[name])
        else:
            known = {word for one in others for word in one.tolist()}
            words = dict.fromkeys(values.tolist())
            found[name] = Fact(value=next((w for w in words if w not in known), next(iter(words))))
    return found


def _constant(windows: WearWindows) -> Callable[[], WearWindows]:
    return lambda: windows


def windows_of(cases: Iterable[Case]) -> WearWindows:
    """Windows of all cases, one after the other."""
    return WearWindows.joined([case.load() for case in cases])


PROGRESS = "progress"
"""Column of the use of the tool, in the unit that was learnt."""


def windows_of_table(table: "pd.DataFrame", file: WearModel) -> tuple[WearWindows, Ints]:
    """Windows of a table, and the window of each row, (T,); the last takes the remainder."""
    wanted = [*file.channels, *file.known.numbers, *file.known.words]
    if missing := [name for name in wanted if name not in table.columns]:
        raise ValueError(f"the input has no column {missing[0]!r}: give {', '.join(wanted)}")
    many = len(table) // file.length
    if not many:
        raise ValueError(
            f"the input has {len(table)} rows, a window has {file.length} at {file.rate_Hz:g} Hz: "
            "give at least as many"
        )
    used = table.iloc[: many * file.length]
    samples = used[list(file.channels)].to_numpy(float)
    if not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0]
        raise ValueError(
            f"{file.channels[column]} holds no finite value in row {row + 1}: leave such rows out"
        )
    starts = np.arange(many) * file.length
    conditions: dict[str, Any] = {
        name: used[name].to_numpy(float)[starts] for name in file.known.numbers
    }
    conditions |= {name: used[name].to_numpy(str)[starts] for name in file.known.words}
    for name in file.known.numbers:
        if not np.isfinite(conditions[name]).all():
            raise ValueError(
                f"condition {name} is not known: give it in {file.condition_units[name]}"
            )
    nothing = np.full(many, np.nan)
    progress = used[PROGRESS].to_numpy(float)[starts] if PROGRESS in used.columns else nothing
    windows = WearWindows(
        values=samples.reshape(many, file.length, -1).transpose(0, 2, 1).astype(np.float32),
        channels=file.channels, units=file.units, rate_Hz=file.rate_Hz, wear=nothing,
        wear_unit=file.wear_unit, measured=np.zeros(many, bool), conditions=conditions,
        condition_units={n: file.condition_units[n] for n in file.known.numbers},
        tool=np.full(many, ""), recording=np.full(many, ""), time=starts / file.rate_Hz,
        progress=progress, progress_unit=file.progress_unit,
    )  # fmt: skip
    return windows, np.minimum(np.arange(len(table)) // file.length, many - 1)
