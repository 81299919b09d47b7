"""Stage: pages of the fleet and of its machines."""

import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from pipeline.fleet import Fleet, missing
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import write_report
from pipeline.report.provenance import RECORD, record_of
from pipeline.report.texts import ReportSettings, texts
from pipeline.schema.store import structured

CODE = Path("data/code.json")
"""Hash of the code of each stage, on which the stage depends."""
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
    history: Path,
    ledger: Path,
    twin_state: Path,
    condition: Path,
    incidents: Path,
    settings: Path,
    reports: Path,
    metrics: Path,
    *,
    fleet: Fleet,
    budget: str,
    pages: ReportSettings,
) -> None:
    """Write a page for the fleet and for each machine, with key figures and metrics."""
    folders = (signals, clean, models, champion, golden, truth, programs, parts, trials, history,
               ledger, twin_state, condition, incidents, settings)  # fmt: skip
    machines, info = machines_of(folders, fleet), info_of(fleet, budget)
    written = write_report(machines, info, reports, reports, metrics, say=texts(pages.language))
    kept = {path for page in written for path in (page, record_of(page))}
    for path in {*reports.glob("*.html"), *reports.glob(f"*{RECORD}")} - kept:
        path.unlink()


def machines_of(folders: Sequence[Path], fleet: Fleet) -> list[MachineFolders]:
    """Folders of each machine of a fleet, from those that stage ``report`` reads, in its order."""
    signals, clean, models, champion, golden, truth, programs, parts, trials, *others = folders
    history, ledger, twin_state, condition, incidents, settings = others
    machines = []
    identities = {name: _identity(signals / name / "manifest.json") for name in fleet.machines}
    for name, identity in identities.items():
        simulated, kind = name in fleet.simulated, identity.get("type", "")
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
                history=history / f"{name}.jsonl",
                ledger=ledger / f"{name}.jsonl",
                twin_state=twin_state / name,
                condition=condition / name,
                incidents=incidents / f"{name}.json",
                trial=trials / f"{name}.json" if name in fleet.trials else None,
                corrected=trials / f"{name}_command_correction.json"
                if name in fleet.trials
                else None,
                settings=settings / f"{name}.json",
                type=kind,
                siblings={
                    other: models / other
                    for other, its in identities.items()
                    if kind and its.get("type") == kind and other != name
                },
                description=identity.get("description", ""),
                credit=identity.get("credit", ""),
                missing=tuple(missing(fleet, name)),
            )
        )
    return machines


def info_of(fleet: Fleet, budget: str) -> FleetInfo:
    """State of the project: fleet, budget, libraries, and the hash of the code of the pages."""
    return FleetInfo(
        name=fleet.name, budget=budget, code=code_of_pages(),
        versions={name: version(name) for name in LIBRARIES},
    )  # fmt: skip


def code_of_pages() -> str:
    """Hash of the code of this stage, as stage ``code`` wrote it; empty where it did not."""
    try:
        return str(json.loads(CODE.read_text(encoding="utf-8")).get("report", ""))
    except (OSError, ValueError):
        return ""


def _identity(manifest: Path) -> dict[str, str]:
    """A machine's identity as its ingest stored it; empty before the first."""
    if not manifest.exists():
        return {}
    return structured(json.loads(manifest.read_text())["machine"], dict[str, str], "machine")
