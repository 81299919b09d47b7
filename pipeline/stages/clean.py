"""Stage: clean a machine's records, only the days that changed."""

from pathlib import Path

from pipeline.signals.cleaning.clean import clean as clean_records
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings


def clean(signals: Path, clean: Path, *, mapping: CleanMachine, cleaning: CleanSettings) -> None:
    """Read ``signals``, write ``clean``."""
    clean_records(signals, clean, machine=mapping, settings=cleaning)
