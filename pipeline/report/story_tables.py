"""Tables about the report itself: what changed, known truth, where everything comes from."""

from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, number, quantity, real
from pipeline.charts.sources import Shelf, dig, objects_of
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.report.changes import Change
from pipeline.report.facts import Facts


def changes_table(found: list[Change]) -> Table | None:
    """Key figures that differ from the last report."""
    if not found:
        return None
    return Table(
        caption="What changed since the last report",
        heads=names("Figure", "before", "now", "change"),
        rows=[cells(c.what, c.before or "–", c.now, c.difference or "–") for c in found],
    )


def provenance_table(shelf: Shelf) -> Table | None:
    """Every file that this page was made from."""
    used = sorted(shelf.used.values(), key=lambda s: s.path)
    if not used:
        return None
    return Table(
        caption=f"Every file that this page was made from ({number(len(used))})",
        heads=names("File", "sha256", "made from"),
        rows=[
            cells(Cell(text=s.path, code=True), Cell(text=s.sha256, code=True), s.made_from or "–")
            for s in used
        ],
        folded=True,
    )


def origins_table(found: Facts) -> Table | None:
    """Raw files by hash that the model was found from, and that it was judged on."""
    rows = [
        cells(use, Cell(text=str(entry.get("file") or NOT_KNOWN), code=True),
              Cell(text=str(entry.get("sha256") or NOT_KNOWN), code=True))
        for use, document, key in (("to learn", found.model.thermal, "found_from"),
                                   ("to judge", found.model.golden, "files"))
        for entry in dig(document, key) or [] if isinstance(entry, dict)
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        caption=f"What the model was found from and judged on{left_out(len(rows), MOST_ROWS)}",
        heads=names("Used", "file", "sha256"),
        rows=rows[:MOST_ROWS],
        sources=sources(
            found.shelf, found.folders.models / "spindle_thermal.json", found.folders.golden
        ),
        folded=True,
    )


def truth_table(found: Facts) -> Table | None:
    """What the simulated machine really did against what was found of it."""
    truth = found.model.truth
    if truth is None:
        return None
    r, cycles = found.reading, found.working.cycles
    true_cycles = dig(truth, "cycles")
    lines = [
        ("records that cannot be read", dig(truth, "log", "counts", "rejected"),
         r.rejected if r.files is not None else None),
        (f"cycles{_unseen(true_cycles)}",
         len(true_cycles) if isinstance(true_cycles, list) else None,
         None if cycles is None else len(cycles)),
        ("wrong values in the log; removed or changed by cleaning", _glitches(truth),
         None if r.changes is None else sum(n for *_, n in r.changes)),
    ]  # fmt: skip
    rows = [cells(w, number(a), number(b), _difference(a, b)) for w, a, b in lines if a is not None]
    for name, p in objects_of(found.model.thermal, "parameters").items():
        value = true_value(truth, name)
        if value is not None:
            unit = str(p.get("unit") or "")
            seen = p.get("value") if p.get("determined") else None
            rows.append(
                cells(Cell(text=name, code=True), quantity(value, unit), quantity(seen, unit),
                      _inside(value, p))
            )  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="What was simulated against what was found",
        heads=[
            Head(name="Quantity"),
            *numbers(("true", ""), ("found", "")),
            Head(name="difference"),
        ],
        rows=rows,
        sources=sources(found.shelf, *([found.folders.truth] if found.folders.truth else [])),
    )


def _unseen(true_cycles: Any) -> str:
    """How many cycles the log cannot show whole, because it was lost at one of their ends."""
    if not isinstance(true_cycles, list):
        return ""
    seen = [c for c in true_cycles if isinstance(c, dict)]
    lost = sum(not (c.get("start_seen", True) and c.get("end_seen", True)) for c in seen)
    return f", of which the log loses an end of {number(lost)}" if lost else ""


def _glitches(truth: dict[str, Any]) -> int | None:
    counts = dig(truth, "log", "counts", "glitches")
    if not isinstance(counts, dict):
        return None
    return sum(n for n in counts.values() if isinstance(n, int))


def true_value(truth: dict[str, Any], name: str) -> float | None:
    """The true value of an identified parameter, where the simulation has one of that name."""
    entry = dig(truth, "parameters", name)
    return real(dig(entry, "value") if isinstance(entry, dict) else entry)


def _difference(true: Any, seen: Any) -> str:
    a, b = real(true), real(seen)
    if a is None or b is None:
        return NOT_KNOWN
    return "none" if a == b else ("+" if b > a else "") + number(int(b - a))


def _inside(true: float, p: dict[str, Any]) -> str:
    interval = p.get("interval_95")
    if not p.get("determined") or not isinstance(interval, list) or len(interval) != 2:
        return NOT_KNOWN
    low, high = (real(x) for x in interval)
    if low is None or high is None:
        return NOT_KNOWN
    inside = low <= true <= high
    return "truth inside the 95 % interval" if inside else "truth outside the 95 % interval"


def simulation_table(found: Facts) -> Table | None:
    """The simulated machine's own parameters, flat."""
    flat = _flat(dig(found.model.truth, "parameters"))
    if not flat or found.folders.truth is None:
        return None
    rows = [cells(Cell(text=name, code=True), value) for name, value in flat]
    return Table(
        caption=f"Parameters of the simulated machine{left_out(len(rows), MOST_ROWS)}",
        heads=names("Parameter", "value"),
        rows=rows[:MOST_ROWS],
        sources=sources(found.shelf, found.folders.truth),
        folded=True,
    )


def _flat(document: Any, prefix: str = "") -> list[tuple[str, str]]:
    if isinstance(document, dict):
        parts = [_flat(v, f"{prefix}.{k}" if prefix else str(k)) for k, v in document.items()]
        return [row for part in parts for row in part]
    if isinstance(document, list) and len(document) > 8:
        return [(prefix, f"{len(document)} entries")]
    if isinstance(document, list):
        parts = [_flat(v, f"{prefix}[{i}]") for i, v in enumerate(document)]
        return [row for part in parts for row in part]
    if document is None or isinstance(document, bool):
        return [(prefix, {None: "none", True: "yes", False: "no"}[document])]
    return [(prefix, document if isinstance(document, str) else number(document))]
