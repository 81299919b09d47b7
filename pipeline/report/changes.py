"""Key figures of a report, and what changed in them since the one before."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, moment, number, real
from pipeline.charts.sources import dig, objects_of
from pipeline.report.control_verdict import worst_error
from pipeline.report.cutting_changes import cutting_figures, cutting_parameters, wear_note
from pipeline.report.drive_units import in_shop_units
from pipeline.report.driven import worst_following, worst_force
from pipeline.report.facts import Facts
from pipeline.report.part_programs import part_changes
from pipeline.report.verdict import Verdict

FORMAT = 1  # of report.json; another one is not compared

FIRST = "There is no earlier report to compare with."

KEYS = {
    "verdict": ("Verdict", ""),
    "days": ("Days with records", ""),
    "last_record": ("Last record", ""),
    "files": ("Raw files", ""),
    "records": ("Records read", ""),
    "rejected": ("Records rejected", ""),
    "gaps": ("Gaps", ""),
    "changes": ("Values changed by cleaning", ""),
    "active_h": ("Time ACTIVE", "h"),
    "cycles": ("Cycles", ""),
    "window_mae_K": ("Error over one hour (MAE)", "K"),
    "free_mae_K": ("Error running free (MAE)", "K"),
    "times_worst_percent": ("Error of program times, worst judged run", "%"),
    "runs_judged": ("Runs judged", ""),
    "programs": ("Part programs", ""),
    "drive_force_percent": ("Error of the axes’ force, worst judged recording", "%"),
    "drive_following_percent": ("Error of following errors, worst judged recording", "%"),
    "drives_judged": ("Axes judged in recordings", ""),
    "cut_rms_percent": ("Error of cutting forces (RMS), worst recording", "%"),
    "cut_peak_percent": ("Error of peak cutting forces, worst recording", "%"),
    "cuts_judged": ("Cuts judged", ""),
    "parts": ("Part programs optimised", ""),
    "parts_before_s": ("Their time as programmed", "s"),
    "parts_after_s": ("Their time optimised", "s"),
}
"""Key figures that are compared: name and unit as shown."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """One key figure then and now, in words; ``note`` says what a change means."""

    what: str
    before: str
    now: str
    difference: str
    note: str = ""


def key_figures(found: Facts, judged: Verdict) -> dict[str, Any]:
    """What of this machine goes into ``report.json``; flat but for parameters and files."""
    v, cycles = found.model.validation, found.working.cycles
    known = found.reading.files is not None
    active = sum(d.seconds.get("ACTIVE", 0.0) for d in found.working.days)
    return {
        "verdict": judged.word,
        "days": len(found.worked_days),
        "last_record": found.last.isoformat() if found.last else None,
        "files": len(found.reading.files or []) if known else None,
        "records": found.reading.records if known else None,
        "rejected": found.reading.rejected if known else None,
        "gaps": _total(found.reading.gap_causes, 1),
        "changes": _total(found.reading.changes, 2),
        "active_h": round(active / 3600, 3) if found.working.days else None,
        "cycles": None if cycles is None else len(cycles),
        "window_mae_K": real(dig(v, "windows", "all", "model", "mae_K")),
        "free_mae_K": real(dig(v, "free_run", "all", "model", "mae_K")),
        "times_worst_percent": worst_error(found.control),
        "runs_judged": len(found.control.judged) if found.control.validation else None,
        "programs": len(found.control.programs) or None,
        **_drive_figures(found),
        **cutting_figures(found.cutting),
        **part_changes(found.parts),
        "parameters": _parameters(found.model.thermal) | {
            f"control {name}": p for name, p in _parameters(found.control.control).items()
        } | {
            f"drive {axis} {name}": {k: v for k, v in in_shop_units(p).items() if k in p}
            for axis, one in found.drives.axes.items()
            for name, p in _parameters(one).items()
        } | cutting_parameters(found.cutting),
        "raw": {f.file: f.sha256 for f in found.reading.files or []},
    }  # fmt: skip


def _drive_figures(found: Facts) -> dict[str, float | int | None]:
    judged = found.drives.judged
    force, following = worst_force(judged), worst_following(judged)
    return {
        "drive_force_percent": force.force_error if force else None,
        "drive_following_percent": following.following_error if following else None,
        "drives_judged": len(judged) if found.drives.validation else None,
    }


def _parameters(document: dict[str, Any] | None) -> dict[str, dict[str, Any]]:
    return {
        name: {
            "value": real(p.get("value")) if p.get("determined") else None,
            "unit": str(p.get("unit") or ""),
        }
        for name, p in objects_of(document, "parameters").items()
    }


def _total(rows: list[Any] | None, place: int) -> int | None:
    return None if rows is None else sum(int(r[place]) for r in rows)


@dataclass(frozen=True, kw_only=True)
class Earlier:
    """What this report is compared with: key figures by machine, or why there are none."""

    machines: dict[str, Any] | None
    why_not: str = ""


def write_key_figures(path: Path, machines: dict[str, dict[str, Any]], earlier: Earlier) -> None:
    """Write ``report.json`` with what it was compared with; equal reports are equal files."""
    document = {"format": FORMAT, "machines": machines, "compared_with": earlier.machines}
    text = json.dumps(document, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def earlier_report(path: Path | None, machines: dict[str, dict[str, Any]]) -> Earlier:
    """The earlier report that one with the key figures ``machines`` is to be compared with.

    ``path`` is the last ``report.json`` or its folder.  When it has the same key figures nothing
    has changed since, and this report is compared with what that one was compared with: a report
    written twice is the same report.
    """
    if path is None:
        return Earlier(machines=None, why_not="No earlier report was given to compare with.")
    file = path / "report.json" if path.is_dir() else path
    if not file.is_file():
        return Earlier(machines=None, why_not=FIRST)
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError):
        broken = "The earlier report.json cannot be read; nothing is compared."
        return Earlier(machines=None, why_not=broken)
    before = dig(document, "machines")
    if dig(document, "format") != FORMAT or not isinstance(before, dict):
        other = "The earlier report.json has another format; nothing is compared."
        return Earlier(machines=None, why_not=other)
    if before == json.loads(json.dumps(machines)):
        before = dig(document, "compared_with")
    return Earlier(machines=before if isinstance(before, dict) else None, why_not=FIRST)


def changes(before: dict[str, Any], now: dict[str, Any]) -> list[Change]:
    """What differs between two sets of key figures of one machine."""
    found = [
        _change(words, unit, before.get(key), now.get(key))
        for key, (words, unit) in KEYS.items() if before.get(key) != now.get(key)
    ]  # fmt: skip
    old, new = (objects_of(d, "parameters") for d in (before, now))
    for name in sorted(set(old) | set(new)):
        a, b = dig(old, name, "value"), dig(new, name, "value")
        if a != b:
            unit = str(dig(new, name, "unit") or dig(old, name, "unit") or "")
            note = wear_note(name, old.get(name, {}), new.get(name, {}))
            found.append(replace(_change(f"Parameter {name}", unit, a, b), note=note))
    old_raw, new_raw = (d.get("raw") for d in (before, now))
    if isinstance(old_raw, dict) and isinstance(new_raw, dict):
        found += _raw_changes(old_raw, new_raw)
    return found


def _change(what: str, unit: str, before: Any, now: Any) -> Change:
    a, b = real(before), real(now)
    difference = ""
    if a is not None and b is not None:
        step = int(b - a) if isinstance(before, int) and isinstance(now, int) else b - a
        difference = ("+" if b > a else "") + _words(step, unit)
    return Change(
        what=what, before=_words(before, unit), now=_words(now, unit), difference=difference
    )


def _words(value: Any, unit: str) -> str:
    if value is None:
        return NOT_KNOWN
    if isinstance(value, str):
        return moment(value) if value[:4].isdigit() and "T" in value else value
    return f"{number(value)} {unit}".strip()


def _raw_changes(old: dict[str, str], new: dict[str, str]) -> list[Change]:
    added, gone = sorted(set(new) - set(old)), sorted(set(old) - set(new))
    changed = sorted(f for f in set(old) & set(new) if old[f] != new[f])
    return [
        Change(what=what, before="", now=_names(files), difference="")
        for what, files in (("New raw files", added), ("Raw files gone", gone),
                            ("Raw files with other content", changed))
        if files
    ]  # fmt: skip


def _names(files: list[str]) -> str:
    more = f" and {len(files) - 5} more" if len(files) > 5 else ""
    return ", ".join(files[:5]) + more
