"""Stage: write the report of the fleet."""

import hashlib
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
    reports: Path,
    *,
    fleet: Fleet,
    budget: str,
    machine: dict[str, Any],
) -> None:
    """Read what the stages before wrote, write the pages."""
    machines = [
        MachineFolders(
            name=name,
            signals=signals / name,
            clean=clean / name,
            models=models / name,
            golden=golden / f"{name}.json",
            origin=machine[name]["identity"]["origin"],
            truth=truth / f"{name}.json" if name in fleet.simulated else None,
            description=machine[name]["identity"]["description"],
            credit=machine[name]["identity"]["credit"],
            missing=tuple(missing(fleet, name)),
        )
        for name in fleet.machines
    ]
    parameters = json.dumps(machine, sort_keys=True).encode()
    info = FleetInfo(
        name=fleet.name,
        params_sha256=hashlib.sha256(parameters).hexdigest(),
        budget=budget,
        notes=(BUDGETS[budget],) if BUDGETS.get(budget) else (),
        versions={name: version(name) for name in LIBRARIES},
    )
    for page in reports.glob("*.html"):
        page.unlink()
    write_report(machines, info, reports, reports)
