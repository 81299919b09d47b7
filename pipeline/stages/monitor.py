"""Stage: incidents of a machine, from its twin's state and the alarms of its control."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.monitoring.forest import KnownGood
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.incidents import monitored
from pipeline.schema.incident import KNOWN_GOOD, MONITOR, Monitor
from pipeline.schema.store import read_json, read_table, write_json
from pipeline.schema.twin_state import MANIFEST, TwinState
from pipeline.signals.columns import component_words


def monitor(
    twin_state: Path, signals: Path, clean: Path, usual: Path, written: Path, *,
    incidents: IncidentSettings,
) -> None:  # fmt: skip
    """Write the incidents of all days, and over how much of them each rule was assessed."""
    state, known = read_json(twin_state / MANIFEST, TwinState), usual / KNOWN_GOOD
    usual_of = read_json(usual / MONITOR, Monitor)
    forest = None
    if usual_of.features:
        columns = dict.fromkeys(usual_of.features, pa.float64())
        forest = KnownGood.of_table(read_table(known, columns), incidents)
    items = signals / "data_items.parquet"
    rows = pq.read_table(items).to_pylist() if items.exists() else []
    conditions = {
        str(one["data_item"]): (component_words(one["component"] or "", one["component_name"] or ""), str(one["type"]))
        for one in rows if one["category"] == "CONDITION"
    }  # fmt: skip
    found = monitored(state, twin_state, clean, usual_of, forest, incidents, conditions)
    write_json(found, written)
