"""Stage: write the report of the fleet."""

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.fleet import Fleet, missing
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import write_report

LIBRARIES = ("numpy", "pandas", "pyarrow", "scikit-learn", "scipy")

BUDGETS = {
    "quick": "Quick budget: one starting point for each fit, one node, a small forest.",
    "default": "Default budget: the forest has 100 trees where the published one has 300.",
    "full": "",
}
"""What a budget cut short."""


def report(
    signals: Path,
    clean: Path,
    models: Path,
    golden: Path,
    truth: Path,
    parts: Path,
    trials: Path,
    reports: Path,
    *,
    fleet: Fleet,
    budget: str,
) -> None:
    """Read what the stages before wrote, write the pages."""
    machines = []
    for name in fleet.machines:
        origin = "simulated" if name in fleet.simulated else "recorded"
        identity = _identity(signals / name / "manifest.json", origin)
        machines.append(
            MachineFolders(
                name=name,
                signals=signals / name,
                clean=clean / name,
                models=models / name,
                golden=golden / f"{name}.json",
                origin=identity["origin"],
                truth=truth / f"{name}.json" if name in fleet.simulated else None,
                parts=parts / name,
                trial=trials / f"{name}.json" if name in fleet.trials else None,
                description=identity["description"],
                credit=identity["credit"],
                missing=tuple(missing(fleet, name)),
            )
        )
    info = FleetInfo(
        name=fleet.name,
        budget=budget,
        notes=(BUDGETS[budget],) if BUDGETS.get(budget) else (),
        versions={name: version(name) for name in LIBRARIES},
    )
    for page in reports.glob("*.html"):
        page.unlink()
    write_report(machines, info, reports, reports)


def _identity(manifest: Path, origin: str) -> dict[str, Any]:
    """Who a machine is, as its ingest wrote it down; before the first, what the fleet knows."""
    if not manifest.exists():
        return {"origin": origin, "description": "", "credit": ""}
    identity: dict[str, Any] = json.loads(manifest.read_text())["machine"]
    return identity
