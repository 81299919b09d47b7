"""Writes the pages: one for the fleet, one for each machine, and the key figures beside them.

Every page is one file that needs nothing else: styles and figures stand in it, it runs no script,
and a content security policy forbids it to load anything.  Text from records is escaped.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import counted, moment, number, percent
from pipeline.report.changes import (
    Earlier,
    changes,
    earlier_report,
    key_figures,
    write_key_figures,
)
from pipeline.report.facts import Facts, facts
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.machine_page import machine_page
from pipeline.report.verdict import Verdict, verdict

__all__ = ["FleetInfo", "MachineFolders", "write_report"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """One machine in the fleet's table, in words."""

    name: str
    origin: str
    description: str
    credit: str
    verdict: Verdict
    days: str
    rejected: str
    last: str


def write_report(
    machines: list[MachineFolders], fleet: FleetInfo, previous: Path | None, out: Path
) -> None:
    """Write ``out/index.html``, ``out/<machine>.html`` and ``out/report.json``.

    Parameters
    ----------
    machines : list of MachineFolders
        The fleet, in the order shown; files that are absent are reported, not raised.
    fleet : FleetInfo
        State of the project.
    previous : Path or None
        ``report.json`` of the last report, or its folder; it may be the one in ``out``.  Written
        again with nothing changed, the pages are the same bytes.
    out : Path
        Folder of the report; made when it does not exist.

    Raises
    ------
    ValueError
        When two machines have the same name.
    """
    names = [m.name for m in machines]
    double = sorted({n for n in names if names.count(n) > 1})
    if double:
        raise ValueError(f"machine {double[0]} stands twice in the fleet; give each its own name")
    found = {m.name: facts(m) for m in machines}
    judged = {name: verdict(f) for name, f in found.items()}
    figures = {name: key_figures(f, judged[name]) for name, f in found.items()}
    earlier = earlier_report(previous, figures)
    out.mkdir(parents=True, exist_ok=True)
    render = _renderer()
    for name in names:
        differences, reason = _compared(earlier, name, figures[name])
        page = machine_page(found[name], judged[name], differences, reason)
        _write(out / f"{name}.html", render("machine.html.j2", page=page, fleet=fleet))
    rows = [_row(found[name], judged[name]) for name in names]
    headline = _headline(rows)
    _write(out / "index.html", render("index.html.j2", rows=rows, fleet=fleet, headline=headline))
    write_key_figures(out / "report.json", figures, earlier)


def _compared(earlier: Earlier, name: str, now: dict[str, Any]) -> tuple[list[Any], str]:
    """Changes of one machine, and what to say when there are none."""
    if earlier.machines is None:
        return [], earlier.why_not
    if not isinstance(earlier.machines.get(name), dict):
        return [], "The machine was not in the last report."
    found = changes(earlier.machines[name], now)
    return found, "" if found else "Nothing: all key figures and raw files are as they were."


def _row(found: Facts, judged: Verdict) -> Row:
    known = found.reading.files is not None
    return Row(
        name=found.folders.name,
        origin=found.folders.origin,
        description=found.folders.description,
        credit=found.folders.credit,
        verdict=judged,
        days=number(len(found.worked_days)) if found.working.days else "not known",
        rejected=percent(found.reading.rejected, found.reading.records) if known else "not known",
        last=moment(found.last),
    )


def _headline(rows: list[Row]) -> str:
    """The fleet in one sentence."""
    counts = {s: sum(r.verdict.status == s for r in rows) for s in _STATUS_WORDS}
    parts = [f"{counts[s]} {words}" for s, words in _STATUS_WORDS.items() if counts[s]]
    return f"{counted(len(rows), 'machine')}: {', '.join(parts)}." if rows else "No machine."


_STATUS_WORDS = {
    "failed": "failed",
    "attention": "passed with reservations",
    "passed": "passed",
    "unknown": "without a verdict",
}


def _renderer() -> Any:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return lambda name, **context: environment.get_template(name).render(**context)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
