"""Stage: incidents of a machine, from its twin's state and the alarms of its control."""

from pathlib import Path

import pyarrow as pa

from pipeline.monitoring.forest import KnownGood
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.incidents import monitored
from pipeline.schema.incident import KNOWN_GOOD, MONITOR, Monitor
from pipeline.schema.store import read_json, read_table, write_json
from pipeline.schema.twin_state import MANIFEST, TwinState


def monitor(
    twin_state: Path, clean: Path, usual: Path, written: Path, *, incidents: IncidentSettings
) -> None:
    """Write the incidents of all days, and over how much of them each rule was assessed."""
    state, known = read_json(twin_state / MANIFEST, TwinState), usual / KNOWN_GOOD
    usual_of = read_json(usual / MONITOR, Monitor)
    forest = None
    if usual_of.features:
        columns = dict.fromkeys(usual_of.features, pa.float64())
        forest = KnownGood.of_table(read_table(known, columns), incidents)
    write_json(monitored(state, twin_state, clean, usual_of, forest, incidents), written)
