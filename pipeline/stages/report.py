"""Stage: write the report of the fleet."""

from pathlib import Path

from pipeline.fleet import Fleet
from pipeline.report.fleet_report import write_fleet_report


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
) -> None:
    """Read what the stages before wrote, write the pages."""
    write_fleet_report(fleet, signals, clean, models, golden, truth, reports, budget)
