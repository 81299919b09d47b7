"""Stage: read a machine's raw files that changed into Parquet."""

from pathlib import Path

from pipeline.schema.identity import MachineIdentity
from pipeline.signals.contracts import check_files
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest as read_records

TABLES = {
    "observations": "observations/*.parquet",
    "traces": "traces/*.parquet",
    "runs": "runs.parquet",
    "rejected": "rejected.parquet",
}


def ingest(
    raw: Path, signals: Path, *, identity: MachineIdentity, records: tuple[RecordSource, ...]
) -> None:
    """Read ``raw`` into ``signals``."""
    read_records(raw, signals, records, identity)
    check_files(signals, TABLES)
