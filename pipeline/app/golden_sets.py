"""Golden and sealed sets on the command line: files that are frozen, and what may replace them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pipeline.app.fleet import DATA, machine_parameters
from pipeline.app.output import LOG, many
from pipeline.champions.serving import history_of
from pipeline.parameters import structure
from pipeline.schema.bundle import VERDICT
from pipeline.schema.days import UTC, day_of_text
from pipeline.schema.golden import Days, FrozenSet, GoldenSets, read_golden
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Role, Verdict


def chosen_set(
    machine: str,
    *,
    first: str | None = None,
    last: str | None = None,
    files: Sequence[str] = (),
) -> FrozenSet:
    """Raw files of ``machine`` as a set that may be frozen.

    ``first`` and ``last``: days of the plant, ``YYYY-MM-DD``, both included; ``files``: patterns of
    further files, and of parts of tables, ``<file>#<column>=<value>``.
    """
    mapping = machine_parameters(machine)["machine"][machine].get("mapping") or {}
    zone = str(mapping.get("time_zone", UTC))
    days = _days(first, last)
    manifest = DATA / "signals" / machine / "manifest.json"
    if not manifest.exists():
        raise ValueError(f"{manifest} does not exist: run `dvc repro ingest@{machine}` first")
    from pipeline.submodels.cases import Records, files_of_days, sources

    known = Records(manifest=manifest).files
    there = _days_there(machine, known, zone)
    names: set[str] = set()
    if days is not None:
        if any(day in days for day in there):
            names = set(files_of_days(known, days, zone))
        if not names:
            listed = f"there are records of {_listed(there)}" if there else "no record has a clock"
            raise ValueError(
                f"{machine} has no record from {days.first} to {days.last}: name other days, or "
                f"put the files of these into data/raw/{machine} and run `dvc repro`; {listed}"
            )
    whole: set[str] = set()
    for pattern in files:
        fitting = _fitting(machine, known, pattern)
        if not fitting:
            raise ValueError(f"{machine} has no raw file {pattern!r}: `kerf golden` names files "
                             "below its folder in data/raw, with * for any letters, and parts of "
                             "tables as <file>#<column>=<value>")  # fmt: skip
        whole |= fitting
    clocked = {one for one in whole - names if days and known.get(one, {}).get("last")}
    names |= whole
    if not names:
        raise ValueError("name what to freeze: --first and --last of a week, or --files")
    return FrozenSet(
        files=sources(known, sorted(names)), days=days, time_zone=zone, whole=tuple(sorted(clocked))
    )


def freeze(
    machine: str, frozen: Mapping[Role, FrozenSet], again: Callable[[str], bool] = lambda _: False
) -> None:
    """Freeze the ``golden`` set of ``machine``, the ``sealed`` set of promotion, or both at once.

    Raises ValueError where the two would share a day or a file, or a committed set would be
    replaced and ``again`` answers no.
    """
    from pipeline.submodels.cases import Records

    path = DATA / "golden" / f"{machine}.json"
    before = read_golden(path) or GoldenSets(machine=machine)
    after = replace(before, golden=frozen.get("golden", before.golden),
                    sealed=frozen.get("sealed", before.sealed))  # fmt: skip
    known = Records(manifest=DATA / "signals" / machine / "manifest.json").files
    if after.golden and after.sealed and (both := shared(after.golden, after.sealed, known)):
        other = " and ".join(name for name in ("golden", "sealed") if name not in frozen)
        raise ValueError(
            f"{both} is in the {other or 'golden'} set of {machine} already: a file, or a day of a "
            "log, is in one of them"
        )
    replaced = [_ask_before(machine, name, getattr(before, name), one, path, again)
                for name, one in frozen.items()]  # fmt: skip
    for words in filter(None, replaced):
        LOG.warning("%s", words)
    if frozen:
        write_json(after, path)


def shared(one: FrozenSet, other: FrozenSet, known: Mapping[str, Mapping[str, Any]]) -> str:
    """First day or file that two sets share, empty where none; a log may have days in both."""
    from pipeline.signals.conditions import share_rows

    days = (one.days, other.days)
    if days[0] and days[1]:
        day = max(days[0].first, days[1].first)
        if day in days[0] and day in days[1]:
            return day

    whole = {*one.whole, *other.whole} if all(days) else {*known}

    def by_days(*names: str) -> bool:
        return all(known.get(name, {}).get("last") and name not in whole for name in names)

    return next((a.file for a in one.files for b in other.files
                 if share_rows(a.file, b.file) and not by_days(a.file, b.file)), "")  # fmt: skip


def _fitting(machine: str, known: Mapping[str, Mapping[str, Any]], pattern: str) -> set[str]:
    """Raw files that fit a pattern, or the parts of tables that it names by their columns."""
    from pipeline.signals.conditions import parts_of, selection

    file, values = selection(pattern)
    fitting = {name for name in known if fnmatchcase(name, file)}
    if not values:
        return fitting
    signals = DATA / "signals" / machine
    tables = {name: str(known[name].get("output") or "") for name in fitting}
    return {
        part.name(name)
        for name, output in tables.items() if output.endswith(".parquet")
        for part in parts_of(signals / output, list(values), "--files")
        if all(fnmatchcase(part.values[column], value) for column, value in values.items())
    }  # fmt: skip


def _ask_before(
    machine: str, name: str, there: FrozenSet | None, frozen: FrozenSet, path: Path,
    again: Callable[[str], bool],
) -> str:  # fmt: skip
    """Words on a set that is replaced; ValueError where it is committed and the answer is no."""
    from pipeline.registry.provenance import git

    if there is None or there == frozen:
        return ""
    said = f"the {name} set {there.sha256[:12]} of {machine}, {many(len(there.files), 'file')}"
    lost = _lost(machine, name, there)
    if git("ls-tree", "HEAD", "--", str(path)):
        question = f"{path} is committed: freeze {many(len(frozen.files), 'file')} in place of"
        if not again(f"{question} {said}{lost}?"):
            raise ValueError(f"{path} is committed: {said} stays; give --again to freeze another "
                             f"in its place{lost}")  # fmt: skip
    return f"{said} is replaced{lost}"


def _lost(machine: str, name: str, there: FrozenSet) -> str:
    """What rests on a set that is to be replaced, in words that follow its name."""
    if name == "sealed":
        looks = sum(entry.sealed == there.sha256 for entry in history_of(machine))
        return f"; {many(looks, 'look')} at it in the history" if looks else ""
    found = [
        path.parent.relative_to(DATA).as_posix()
        for folder in ("champion", "models")
        for path in sorted((DATA / folder / machine).glob(f"*/{VERDICT}"))
        if (used := read_json(path, Verdict).golden) is not None and used.sha256 == there.sha256
    ]
    if not found:
        return ""
    return f"; scores on it no longer compare with new ones: {', '.join(found)}"


def _days_there(machine: str, known: Mapping[str, Mapping[str, Any]], zone: str) -> list[str]:
    """Days of the plant with records: of the clean tables, without any those on which files end."""
    from pipeline.signals.windows import state_days

    cleaned = state_days(DATA / "clean" / machine)
    ends = {day_of_text(str(entry["last"]), zone) for entry in known.values() if entry.get("last")}
    return cleaned or sorted(ends)


def _listed(days: Sequence[str]) -> str:
    spans: list[list[date]] = []
    for day in map(date.fromisoformat, days):
        if spans and (day - spans[-1][1]).days == 1:
            spans[-1][1] = day
        else:
            spans.append([day, day])
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in spans)


def learnt_and_frozen(machine: str, frozen: FrozenSet) -> str | None:
    """A warning when a frozen set takes days or files that the roles give to training."""
    from pipeline.submodels.cases import Roles

    roles = structure(machine_parameters(machine), f"machine.{machine}.roles", Roles)
    days, learnt = frozen.days, roles.training_days
    for one in frozen.files:
        if roles.is_training(one.file):
            return f"{one.file} is a training file of roles.training: nothing learns from it now"
    if days is None or learnt is None or days.last < learnt.first or learnt.last < days.first:
        return None
    whole = days.first <= learnt.first and learnt.last <= days.last
    left = "no day is left to learn from" if whole else "nothing learns from the shared days now"
    return (
        f"{days.first} to {days.last} overlaps roles.training_days, {learnt.first} to "
        f"{learnt.last}: {left}; freeze other days, or name other training days"
    )


def _days(first: str | None, last: str | None) -> Days | None:
    if first is None and last is None:
        return None
    if first is None or last is None:
        raise ValueError("--first and --last go together: name both days, or none")
    return Days(first=first, last=last)
