"""Stage: clean a machine's records, only the days that changed."""

from pathlib import Path

from pipeline.signals.cleaning.clean import clean as clean_records
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.signals.contracts import check_files

TABLES = {"state": "state/*.parquet"} | {
    name: f"{name}.parquet" for name in ("cycles", "segments", "audit", "gaps", "alarms")
}


def clean(signals: Path, clean: Path, *, mapping: CleanMachine, cleaning: CleanSettings) -> None:
    """Read ``signals``, write ``clean``."""
    clean_records(signals, clean, machine=mapping, settings=cleaning)
    check_files(clean, TABLES)
