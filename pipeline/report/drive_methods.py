"""Least squares against the genetic search, on the same records: table, and who won."""

from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, counted, number, powers, real
from pipeline.charts.sources import rows_of
from pipeline.charts.tables import Cell, Table, cells, names, numbers
from pipeline.report.drive_tables import drive_sources
from pipeline.report.facts import Facts

ALIKE = 1e-3  # of an error; two searches closer than that have found the same optimum
METHODS = {"least_squares": "least squares", "genetic": "genetic search"}


def methods_table(found: Facts) -> Table | None:
    """Each search on the same data: its error, its evaluations, and which one was kept."""
    rows = [
        _method_row(axis, row)
        for axis, one in found.drives.axes.items() for row in rows_of(one, "methods")
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="Least squares against genetic search, on the same records",
        heads=[*names("Axis", "what was fitted", "method"), *numbers(("error", "")),
               *names("unit"), *numbers(("evaluations", "")), *names("kept")],
        rows=rows,
        sources=drive_sources(found),
        folded=True,
    )  # fmt: skip


def _method_row(axis: str, row: dict[str, Any]) -> list[Cell]:
    method = str(row.get("method") or NOT_KNOWN)
    evaluations = real(row.get("evaluations"))
    return cells(
        axis,
        str(row.get("task") or NOT_KNOWN).replace("_", " "),
        METHODS.get(method, method),
        number(real(row.get("error")), 4),
        powers(str(row.get("error_unit") or "–")),
        NOT_KNOWN if evaluations is None else number(round(evaluations)),
        "kept" if row.get("chosen") is True else "–",
    )


def methods_words(found: Facts) -> str:
    """Which search won, in one sentence; empty without two on the same task."""
    duels = [d for one in found.drives.axes.values() for d in _duels(rows_of(one, "methods"))]
    if not duels:
        return ""
    equal = [abs(a - b) <= ALIKE * max(abs(a), abs(b)) for a, b, _ in duels]
    wins = [
        sum(not same and sign * (b - a) > 0 for (a, b, _), same in zip(duels, equal, strict=True))
        for sign in (1, -1)
    ]
    won = "Neither search won" if wins[0] == wins[1] else (
        f"{'Least squares' if wins[0] > wins[1] else 'The genetic search'} won"
    )  # fmt: skip
    text = (
        f"{won}: of {counted(len(duels), 'task')} least squares has the smaller error in "
        f"{wins[0]}, the genetic search in {wins[1]}, and in {sum(equal)} they are alike within "
        f"{100 * ALIKE:g} %"
    )
    ratios = sorted(ratio for *_, ratio in duels if ratio > 0)
    if not ratios:
        return text + "."
    return (
        f"{text}; for each evaluation of least squares the genetic search needed "
        f"{number(ratios[len(ratios) // 2], 2)} (median)."
    )


def _duels(methods: list[dict[str, Any]]) -> list[tuple[float, float, float]]:
    """Of each task: error of least squares, of the genetic search, its evaluations to 1."""
    tasks: dict[str, dict[str, dict[str, Any]]] = {}
    for row in methods:
        tasks.setdefault(str(row.get("task")), {})[str(row.get("method"))] = row
    found = []
    for by_method in tasks.values():
        pair = [by_method.get(name, {}) for name in METHODS]
        errors = [real(row.get("error")) for row in pair]
        spent = [real(row.get("evaluations")) for row in pair]
        if errors[0] is None or errors[1] is None:
            continue
        ratio = spent[1] / spent[0] if spent[0] and spent[1] else 0.0
        found.append((errors[0], errors[1], ratio))
    return found
