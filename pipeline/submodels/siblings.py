"""Section on a machine's siblings: its parameters pooled with those of machines of its type.

Shown, not used: what serves is the machine's own model.  A parameter that its records do not
determine has the siblings' value with its interval as a proposal.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import NARROW, between, counted, joined, number, resolved
from pipeline.charts.parameters import in_units, unit_of
from pipeline.charts.sections import Section, present
from pipeline.charts.submodel_page import PageContent
from pipeline.charts.tables import MOST_ROWS, Cell, Column, code, sources, tabulated
from pipeline.schema.model import Model, Parameter
from pipeline.submodels.contract import Shown, SubModel
from pipeline.submodels.pooling import BETWEEN, Pooled, pooled


@dataclass(frozen=True, kw_only=True)
class _Row:
    """A parameter as a shop speaks it, alone and pooled."""

    name: str
    means: str
    own: Parameter
    pooled: Pooled

    @property
    def digits(self) -> int:
        """Digits that the pooled interval leaves."""
        return resolved(*self.pooled.interval_95)


def siblings_section(
    one: SubModel[Any, Any, Any],
    shown: Shown[Any],
    content: PageContent,
    kind: str,
    folders: Mapping[str, Path],
) -> Section | None:
    """Parameters of a machine pooled with those of the machines of its type.

    ``content``: the sub-model's page, for meanings and units; ``kind``: the machines' type;
    ``folders``: folders of the siblings' models by machine.  None where the sub-model pools
    nothing, or the machine has no model or no type.
    """
    if not one.shared or shown.model is None or not kind:
        return None
    paths = {machine: folder / one.name / "model.json" for machine, folder in folders.items()}
    read = {machine: shown.shelf.read(path, one.model) for machine, path in paths.items()}
    siblings = {machine: model for machine, model in read.items() if model is not None}
    kin = one.alike(shown.model)
    alike = {machine: model for machine, model in siblings.items() if one.alike(model) == kin}
    apart = sorted(set(siblings) - set(alike))
    other = f"Not pooled with {joined(apart)}: {one.unlike}." if apart else ""
    if not alike:
        said = f"No other machine of type {kind} in this fleet has a model to pool with."
        return Section(key="siblings", title="Siblings", text=[said, *filter(None, [other])])
    rows = list(_rows(one, shown.model, alike, content))
    text = [
        f"Pooled with {joined(sorted(alike))}, of the same type ({kind}): each machine’s value "
        "counts by how well its records determine it, and by how far machines of the type differ. "
        "Nothing uses these values: what serves is the machine’s own model.",
        _moved_words(rows), _open_words(rows), _few_words(len(alike)), other,
    ]  # fmt: skip
    made = sources(shown.shelf, shown.folder / "model.json", *(paths[name] for name in alike))
    table = tabulated("Own records and siblings", rows, COLUMNS, made, most=MOST_ROWS, folded=True)
    return Section(
        key="siblings", title="Siblings", text=[*filter(None, text)], blocks=present(table)
    )


def _rows(
    one: SubModel[Any, Any, Any], model: Model, siblings: Mapping[str, Model], content: PageContent
) -> "list[_Row]":
    found = []
    for group, parameters in model.parameters.items():
        for name, own in parameters.items():
            whole = f"{group} {name}".strip()
            if not re.fullmatch(one.shared, whole):
                continue
            theirs = [sibling.parameters.get(group, {}).get(name) for sibling in siblings.values()]
            shown = in_units(own, content.units)
            alike = [in_units(p, content.units) for p in theirs if p and p.unit == own.unit]
            if (both := pooled(shown, alike)) is not None:
                found.append(
                    _Row(name=whole, means=content.meaning(group, name), own=shown, pooled=both)
                )
    return found


def _known(row: _Row) -> bool:
    return row.own.determined and row.own.value is not None


def _moved_words(rows: "list[_Row]") -> str:
    moved = sorted(row.pooled.moved for row in rows if _known(row))
    if not moved:
        return ""
    if len(moved) == 1:
        return (
            f"The machine’s own records moved 1 value by {_share(moved[0])} of the way from the "
            "siblings’ mean."
        )
    return (
        f"The machine’s own records moved {counted(len(moved), 'value')} by {_share(moved[0])} to "
        f"{_share(moved[-1])} of the way from the siblings’ mean, half of them by at least "
        f"{_share(moved[len(moved) // 2])}."
    )


def _open_words(rows: "list[_Row]") -> str:
    many = sum(not _known(row) for row in rows)
    if not many:
        return ""
    return (
        f"Its records do not determine {counted(many, 'value')}, which the siblings propose with "
        "an interval."
    )


def _few_words(siblings: int) -> str:
    if siblings > 1:
        return ""
    return (
        "A single sibling says little of how far machines of a type differ: a standard deviation "
        f"of {100 * BETWEEN:.0f}{NARROW}% or so is assumed until there are more."
    )


def _share(part: float) -> str:
    return f"{100 * part:.0f}{NARROW}%"


COLUMNS: tuple[Column[_Row], ...] = (
    Column("Parameter", lambda row: code(row.name)),
    Column("means", lambda row: row.means),
    Column("own records", lambda row: number(row.own.value, row.digits) if _known(row) else
           Cell(text="not determined", status="unknown"), ""),
    Column("siblings’ mean", lambda row: number(row.pooled.expected, row.digits), ""),
    Column("siblings", lambda row: str(row.pooled.siblings), ""),
    Column("pooled", lambda row: number(row.pooled.value, row.digits) if _known(row) else
           Cell(text=f"{number(row.pooled.value, row.digits)}, proposed", status="unknown"), ""),
    Column("95 % interval", lambda row: between(*row.pooled.interval_95), ""),
    Column("unit", lambda row: unit_of(row.own)),
    Column("moved by own records",
           lambda row: _share(row.pooled.moved) if _known(row) else "–", ""),
)  # fmt: skip
