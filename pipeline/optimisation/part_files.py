"""An optimised part on disk: the program before and after, its document, figures to compare."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

DIGITS = 4
"""Of a figure that is compared."""


def write_part(
    label: str, before: bytes, after: bytes, document: Mapping[str, Any], out: Path
) -> None:
    """Write ``<label>.before.nc``, ``<label>.nc`` and ``<label>.json`` into the folder ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    (out / f"{label}.before.nc").write_bytes(before)
    (out / f"{label}.nc").write_bytes(after)
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False)
    (out / f"{label}.json").write_text(text + "\n", encoding="utf-8")


def part_metrics(documents: Mapping[str, Mapping[str, Any]]) -> dict[str, float | int | bool]:
    """What ``dvc metrics`` shows of parts: flat, the unit in the name; unknown ones are left out.

    Parameters
    ----------
    documents : mapping of str to dict
        Documents by label.
    """
    found: dict[str, float | int | bool] = {}
    for label, document in documents.items():
        currency = str(document.get("currency") or "currency")
        for when in ("before", "after"):
            for key in ("time_s", "cost", "peak_load_N"):
                name = f"cost_{currency}" if key == "cost" else key
                _put(found, f"{label}_{when}_{name}", (document.get(when) or {}).get(key))
        certainty = document.get("certainty") or {}
        _put(found, f"{label}_exceedance", certainty.get("exceedance"))
        found[f"{label}_same_geometry"] = bool((document.get("proof") or {}).get("same"))
    return found


def _put(found: dict[str, float | int | bool], name: str, value: Any) -> None:
    if isinstance(value, int | float) and not isinstance(value, bool):
        found[name] = float(f"{value:.{DIGITS}g}")
