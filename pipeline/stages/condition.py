"""Stage: condition of a machine week by week, as a kept series of reports."""

from pathlib import Path

from pipeline.monitoring.condition import ConditionSettings, write_reports
from pipeline.signals.cleaning.settings import CleanSettings


def condition(
    twin_state: Path,
    clean: Path,
    ledger: Path,
    reports: Path,
    *,
    condition: ConditionSettings,
    cleaning: CleanSettings,
) -> None:
    """Write the report of each week that is new or whose records have changed."""
    write_reports(twin_state, clean, ledger, reports, settings=condition,
                  turning_rpm=cleaning.turning_rpm)  # fmt: skip
