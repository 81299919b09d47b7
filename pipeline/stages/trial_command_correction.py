"""Stage: commands and corrected commands driven on the simulated shop floor's axes."""

import json
from pathlib import Path
from typing import Any

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.trials import corrected_trials


def trial_command_correction(corrected: Path, driven: Path, *, shop: ShopParameters) -> None:
    """Drive every ``*.csv`` of ``corrected``, each seed a noise of its own; one JSON for all."""
    tables = sorted(corrected.glob("*.csv"))
    if not tables:
        raise ValueError(f"{corrected} holds no *.csv: correct the commands of a program first")
    found = {table.stem: _driven(table, shop) for table in tables}
    document = {"machine": shop.machine, "origin": "simulated", "programs": found}
    driven.write_text(json.dumps(document, indent=1) + "\n")


def _driven(table: Path, shop: ShopParameters) -> dict[str, Any]:
    """Axes driven along a table; its reason where it only says why it is none."""
    lines = table.read_text().splitlines()
    if all(line.startswith("#") for line in lines):
        return {"refused": " ".join(line.lstrip("# ") for line in lines)}
    return corrected_trials(table, shop, range(shop.trial_drives))
