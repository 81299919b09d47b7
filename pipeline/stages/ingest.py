"""Stage: read a machine's raw files that changed into Parquet."""

import sys
from pathlib import Path

from pipeline.schema.identity import MachineIdentity
from pipeline.signals.contracts import check_files
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest as read_records
from pipeline.signals.store import early_ends, strangers_said

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
    said = [f"{name}: {why}" for name, why in early_ends(signals).items()]
    for one in filter(None, (*said, strangers_said(signals))):
        sys.stderr.write(f"ingest@{identity.name}: {one}\n")
    check_files(signals, TABLES)
