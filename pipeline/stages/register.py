"""Stage: register every machine's bundle, once for each content."""

import json
from pathlib import Path

from pipeline.fleet import Fleet
from pipeline.registry import register as register_bundle


def register(models: Path, registered: Path, *, fleet: Fleet) -> None:
    """Register ``models/<machine>`` of every machine with a spindle; write what is registered."""
    found = {}
    for name in fleet.spindles:
        document = json.loads((models / name / "spindle_thermal.json").read_text())
        made_with = {key: document[key] for key in ("records", "network", "training_days")}
        version = register_bundle(name, models / name, made_with)
        found[name] = {"bundle_sha256": version.bundle, "verdict": version.verdict}
    registered.write_text(json.dumps(found, indent=2, sort_keys=True) + "\n")
