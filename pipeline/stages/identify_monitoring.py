"""Stage: what is usual for a machine on its known-good days."""

from pathlib import Path

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.usual import identify_monitor
from pipeline.schema.incident import KNOWN_GOOD, MONITOR
from pipeline.schema.store import read_json, write_json, write_table
from pipeline.schema.twin_state import MANIFEST, TwinState


def identify_monitoring(
    twin_state: Path, clean: Path, usual: Path, *, incidents: IncidentSettings
) -> None:
    """Write limits, usual loads, and the windows that the isolation forest is grown from."""
    state = read_json(twin_state / MANIFEST, TwinState)
    found = identify_monitor(state, twin_state, clean, incidents)
    usual.mkdir(parents=True, exist_ok=True)
    write_json(found.monitor, usual / MONITOR)
    (usual / KNOWN_GOOD).unlink(missing_ok=True)
    if found.known_good is not None:
        write_table(found.known_good.table(), usual / KNOWN_GOOD)
