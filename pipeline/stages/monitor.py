"""Stage: incidents of a machine, from its twin's state and the alarms of its control."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.monitoring.forest import KnownGood
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.incidents import monitored
from pipeline.monitoring.usual import Usual
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.incident import KNOWN_GOOD, MONITOR, Monitor
from pipeline.schema.store import read_json, read_table, write_json
from pipeline.schema.twin_state import MANIFEST, TwinState
from pipeline.signals.columns import component_words


def monitor(
    twin_state: Path, signals: Path, clean: Path, usual: Path, written: Path, *,
    identity: MachineIdentity, incidents: IncidentSettings,
) -> None:  # fmt: skip
    """Write the incidents of all days, and over how much of them each rule was assessed."""
    state, known_good = read_json(twin_state / MANIFEST, TwinState), None
    learnt = read_json(usual / MONITOR, Monitor)
    if learnt.features:
        columns = dict.fromkeys(learnt.features, pa.float64())
        known_good = KnownGood.of_table(read_table(usual / KNOWN_GOOD, columns), incidents)
    items = signals / "data_items.parquet"
    rows = pq.read_table(items).to_pylist() if items.exists() else []
    conditions = {}
    for one in rows:
        if one["category"] == "CONDITION":
            where = component_words(one["component"] or "", one["component_name"] or "")
            conditions[str(one["data_item"])] = where, str(one["type"])
    usual_of = Usual(monitor=learnt, known_good=known_good)
    found = monitored(
        state, twin_state, clean, usual_of, identity=identity, settings=incidents,
        conditions=conditions,
    )  # fmt: skip
    write_json(found, written)
