"""Stage: pages of the fleet and of its machines."""

import json
from importlib.metadata import version
from pathlib import Path

from pipeline.fleet import Fleet, missing
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import write_report
from pipeline.report.texts import ReportSettings, texts
from pipeline.schema.store import structured

LIBRARIES = ("numpy", "pandas", "pyarrow", "scikit-learn", "scipy")


def report(
    signals: Path,
    clean: Path,
    models: Path,
    champion: Path,
    golden: Path,
    truth: Path,
    programs: Path,
    parts: Path,
    trials: Path,
    ledger: Path,
    reports: Path,
    metrics: Path,
    *,
    fleet: Fleet,
    budget: str,
    pages: ReportSettings,
) -> None:
    """Write a page for the fleet and for each machine, with key figures and metrics."""
    machines = []
    for name in fleet.machines:
        simulated = name in fleet.simulated
        identity = _identity(signals / name / "manifest.json")
        origin = identity.get("origin", "simulated" if simulated else "recorded")
        machines.append(
            MachineFolders(
                name=name,
                signals=signals / name,
                clean=clean / name,
                models=models / name,
                submodels=fleet.submodels_of(name),
                champion=champion / name,
                golden=golden / f"{name}.json",
                origin="simulated" if origin == "simulated" else "recorded",
                truth=truth / f"{name}.json" if simulated else None,
                programs=programs / name,
                parts=parts / name,
                ledger=ledger / f"{name}.jsonl",
                trial=trials / f"{name}.json" if name in fleet.trials else None,
                corrected=trials / f"{name}_command_correction.json"
                if name in fleet.trials
                else None,
                description=identity.get("description", ""),
                credit=identity.get("credit", ""),
                missing=tuple(missing(fleet, name)),
            )
        )
    info = FleetInfo(
        name=fleet.name,
        budget=budget,
        versions={name: version(name) for name in LIBRARIES},
    )
    written = write_report(machines, info, reports, reports, metrics, say=texts(pages.language))
    for page in set(reports.glob("*.html")) - set(written):
        page.unlink()


def _identity(manifest: Path) -> dict[str, str]:
    """A machine's identity as its ingest stored it; empty before the first."""
    if not manifest.exists():
        return {}
    return structured(json.loads(manifest.read_text())["machine"], dict[str, str], "machine")
