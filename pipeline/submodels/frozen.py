"""Frozen sets and leaks: raw bytes that a model was fitted on, files that have changed."""

from collections.abc import Iterable, Mapping
from typing import Any

from pipeline.schema.days import day_of_text, is_day
from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.model import Model
from pipeline.schema.verdict import GoldenUsed
from pipeline.signals.conditions import selection
from pipeline.submodels.cases import Case, learnt_from


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
