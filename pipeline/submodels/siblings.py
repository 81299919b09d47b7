"""Section on a machine's siblings: its parameters pooled with those of machines of its type.

Shown, not used: what serves is the machine's own model.  A parameter that its records do not
determine has the siblings' value with its interval as a proposal.
"""

import re
from collections.abc import Iterator, Mapping
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
    other = f"Not pooled with {joined(apart)}, of the same type: {one.unlike}." if apart else ""
    if not alike:
        said = other or f"No other machine of type {kind} in this fleet has a model to pool with."
        return Section(key="siblings", title="Siblings", text=[said])
    rows = list(_rows(one, shown.model, alike, content))
    text = [
        f"Pooled with {joined(sorted(alike))}, of the same type ({kind}): each machine’s value "
        "counts by how well its records determine it, and by how far machines of the type differ. "
        "Nothing uses these values: what serves is the machine’s own model.",
        *_words(rows, len(alike)), other,
    ]  # fmt: skip
    made = sources(shown.shelf, shown.folder / "model.json", *(paths[name] for name in alike))
    table = tabulated(
        "Own records and siblings", rows, _columns(len(alike)), made, most=MOST_ROWS, folded=True
    )
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


def _theirs(siblings: int) -> str:
    return "siblings’ mean" if siblings > 1 else "sibling’s value"


def _words(rows: "list[_Row]", siblings: int) -> Iterator[str]:
    """How far the own records moved the values, how many they leave open, a warning of one."""
    moved = [row.pooled.moved for row in rows if _known(row)]
    if moved:
        shares = dict.fromkeys(map(_share, (min(moved), max(moved))))
        yield (
            f"The machine’s own records moved {counted(len(moved), 'value')} by "
            f"{' to '.join(shares)} of the way from the {_theirs(siblings)}."
        )
    if many := len(rows) - len(moved):
        theirs = "siblings propose" if siblings > 1 else "sibling proposes"
        yield (
            f"Its records do not determine {counted(many, 'value')}, which the {theirs} with an "
            "interval."
        )
    if siblings == 1:
        yield (
            "A single sibling says little of how far machines of a type differ: a standard "
            f"deviation of {100 * BETWEEN:.0f}{NARROW}% or so is assumed until there are more."
        )


def _share(part: float) -> str:
    return f"{100 * part:.0f}{NARROW}%"


def _columns(siblings: int) -> tuple[Column[_Row], ...]:
    unknown = Cell(text="not determined", status="unknown")
    many = [Column[_Row]("siblings", lambda row: str(row.pooled.siblings), "")]
    return (
        Column("Parameter", lambda row: code(row.name)),
        Column("means", lambda row: row.means),
        Column("own records", lambda row: number(row.own.value, row.digits) if _known(row) else
               unknown, ""),
        Column(_theirs(siblings), lambda row: number(row.pooled.expected, row.digits), ""),
        *(many if siblings > 1 else []),
        Column("pooled", lambda row: number(row.pooled.value, row.digits) if _known(row) else
               Cell(text=f"{number(row.pooled.value, row.digits)}, proposed", status="unknown"),
               ""),
        Column("95 % interval", lambda row: between(*row.pooled.interval_95), ""),
        Column("unit", lambda row: unit_of(row.own)),
        Column("moved by own records",
               lambda row: _share(row.pooled.moved) if _known(row) else "–", ""),
    )  # fmt: skip
