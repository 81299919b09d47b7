"""Cases of each sub-model of a machine in its frozen sets, and what is too little to freeze."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from glob import escape
from typing import Any

from pipeline.app.fleet import CONF, DATA, machine_parameters
from pipeline.app.golden_sets import chosen_set, freeze
from pipeline.app.output import NONE, aligned, many
from pipeline.champions.serving import history_of
from pipeline.fleet import Fleet
from pipeline.parameters import read_yaml, section_path, structure
from pipeline.schema.days import is_day
from pipeline.schema.golden import FrozenSet, GoldenSets, read_golden
from pipeline.schema.model import LeftOut, SourceFile
from pipeline.schema.verdict import Role
from pipeline.signals.conditions import PART, selection
from pipeline.submodels.cases import Case, Cases, Records, Roles
from pipeline.submodels.contract import judging_of, submodel

SEALED_OF = 4
"""Groups that nothing learns from of which one is sealed [1]."""
FROZEN: tuple[Role, ...] = ("golden", "sealed")
ROLES: tuple[Role, ...] = (*FROZEN, "held_out", "training")
"""Roles in the order in which their cases are counted, those of the sets first."""


def frozen_cases(machine: str) -> dict[str, Any]:
    """Frozen sets of ``machine`` and its cases by sub-model and role, from its ingested records."""
    manifest = DATA / "signals" / machine / "manifest.json"
    values = machine_parameters(machine)
    if not manifest.exists():
        raise ValueError(f"{manifest} does not exist: run `dvc repro ingest@{machine}` first")
    sets = read_golden(DATA / "golden" / f"{machine}.json")
    known = sets or GoldenSets(machine=machine)
    looks = [one for one in history_of(machine) if one.sealed]
    return {
        "machine": machine,
        "golden": _summary(known.golden),
        "sealed": _summary(known.sealed),
        "looks": len(looks),
        "submodels": [
            _counted(name, _cases(name, machine, values, sets)) for name in _submodels(machine)
        ],
    }


def frozen_text(found: dict[str, Any]) -> Iterator[str]:
    """Lines on :func:`frozen_cases`: both sets, a table of its cases by role, and their names."""
    said = [
        f"{name} set {many(len(found[name]['files']), 'file')}, sha256 {found[name]['sha256'][:12]}"
        if found[name] else f"no {name} set"
        for name in FROZEN
    ]  # fmt: skip
    looked = f", {many(found['looks'], 'look')}" if found["sealed"] else ""
    yield f"{found['machine']}: {'; '.join(said)}{looked}"
    heads = ["sub-model", *(role.replace("_", " ") for role in ROLES), "not frozen"]
    rows = [[one["submodel"], *(str(one[role]) for role in ROLES), one["lacking"] or NONE]
            for one in found["submodels"]]  # fmt: skip
    yield from aligned([heads, *rows], words=len(heads))
    for name in FROZEN:
        if found[name]:
            days = found[name]["days"]
            first = [f"days {days['first']} to {days['last']}"] if days else []
            yield f"{name} set: {', '.join(first + [f['file'] for f in found[name]['files']])}"
        for one in found["submodels"]:
            if one["frozen"][name]:
                yield f"{one['submodel']}, {name} cases: {', '.join(one['frozen'][name])}"


def _counted(name: str, cases: Cases) -> dict[str, Any]:
    """Cases of a sub-model by role, names of the frozen ones, and why a set has none."""
    refused = "" if cases.cases or not cases.left_out else f"no case: {cases.left_out[0].reason}"
    return {
        "submodel": name,
        **{role: len(cases.of(role)) for role in ROLES},
        "frozen": {role: [case.name for case in cases.of(role)] for role in FROZEN},
        "lacking": refused or lacking(cases),
    }


def _summary(frozen: FrozenSet | None) -> dict[str, Any] | None:
    return None if frozen is None else asdict(frozen) | {"sha256": frozen.sha256}


def _submodels(machine: str) -> list[str]:
    """Sub-models of a machine by the fleets that it stands in."""
    found: set[str] = set()
    for path in sorted((CONF / "fleet").glob("*.yaml")):
        fleet = structure({"fleet": read_yaml(path.read_text())}, "fleet", Fleet)
        found |= set(fleet.submodels_of(machine))
    return sorted(found)


def _cases(name: str, machine: str, values: dict[str, Any], sets: GoldenSets | None) -> Cases:
    """Cases of a sub-model; without any, and with the reason, where its records are refused."""
    one = submodel(name)
    records = Records.of_machine(DATA, machine, DATA / "models" / machine)
    try:
        return one.cases(records, judging_of(one, values, machine), sets)
    except ValueError as error:
        return Cases(cases=(), left_out=(LeftOut(case=name, reason=str(error)),))


def _free(cases: Cases) -> list[Case]:
    """Cases that may be frozen: nothing learns from their bytes, or from a time of their file.

    Days of a log may be, beside those that are learnt from, and parts of a table by its columns.
    """
    training = [one for case in cases.of("training") for one in case.files]
    learnt = {one.sha256 for one in training}
    begun = {one.file.partition(PART)[0] for one in training if not selection(one.file)[1]}

    def is_free(case: Case, one: SourceFile) -> bool:
        if is_day(case.group):
            return True
        parted = bool(selection(one.file)[1])
        return one.sha256 not in learnt and (parted or one.file.partition(PART)[0] not in begun)

    others = cases.of("golden", "sealed", "held_out")
    return [case for case in others if all(is_free(case, one) for one in case.files)]


def lacking(cases: Cases) -> str:
    """Why some set has no case; empty where both have one."""
    there = [role for role in ("golden", "sealed") if cases.of(role)]
    if len(there) == 2:
        return ""
    groups = len({case.group for case in _free(cases)})
    left = f"{many(groups, 'group')} that nothing learns from"
    needed = f"{SEALED_OF} are needed, {SEALED_OF - 1} to judge by and 1 to seal"
    if groups < SEALED_OF:
        return f"too little to {'seal' if there == ['golden'] else 'freeze'}: {left}, {needed}"
    missing = " and ".join(one for one in ("golden", "sealed") if one not in there)
    return f"{left}, none in the {missing} set: freeze them with `kerf golden --split`"


def split_sets(machine: str, again: Callable[[str], bool]) -> None:
    """Freeze all that nothing of ``machine`` learns from, as its golden and its sealed set.

    Groups are whole (days, recordings, tools), days those after the ones that are learnt from;
    :func:`sealed_of` says which are sealed.
    """
    values = machine_parameters(machine)
    by_name = {name: _cases(name, machine, values, None) for name in _submodels(machine)}
    roles = structure(values, section_path(values, "roles", machine), Roles)
    learnt = {one.file for cases in by_name.values() for case in cases.of("training")
              for one in case.files}  # fmt: skip
    after = "" if roles.training_days is None else roles.training_days.last
    golden: set[str] = set()
    sealed: set[str] = set()
    days: tuple[list[str], list[str]] = ([], [])
    for cases in by_name.values():
        groups: dict[str, list[Case]] = {}
        for case in sorted(_free(cases), key=lambda one: one.name):
            if is_day(case.group):
                ours = case.group > after
            else:
                ours = not any(f.file in learnt or roles.is_training(f.file) for f in case.files)
            if ours:
                groups.setdefault(case.group, []).append(case)
        last = sealed_of(groups)
        for group, own in groups.items():
            files = {one.file for case in own for one in case.files}
            if is_day(group):
                days[group in last].append(group)
            elif not files & golden and (files & sealed or group in last):
                sealed |= files
            else:
                golden |= files - sealed
    chosen = {
        name: chosen_set(machine, first=min(own, default=None), last=max(own, default=None),
                         files=[escape(one) for one in sorted(files)])
        for name, files, own in zip(FROZEN, (golden, sealed), days, strict=True) if files or own
    }  # fmt: skip
    freeze(machine, chosen, again)


def sealed_of(groups: Mapping[str, Sequence[Case]]) -> set[str]:
    """Groups to seal, of those in order that nothing learns from: one of four.

    Of days they are the last; of others the last of each four without which the golden ones still
    have every condition that it has, so that what a set judges does not shrink.
    """
    names = list(groups)
    if names and all(is_day(name) for name in names):
        return set(names[len(names) - len(names) // SEALED_OF :])
    kinds = {
        name: {kind for case in own for kind, fact in case.conditions.items() if fact.value}
        for name, own in groups.items()
    }
    found: set[str] = set()
    for start in range(0, len(names) - SEALED_OF + 1, SEALED_OF):
        for name in reversed(names[start : start + SEALED_OF]):
            others = set().union(*(kinds[one] for one in names if one not in {*found, name}))
            if kinds[name] <= others and (kinds[name] or not any(kinds.values())):
                found.add(name)
                break
    return found
