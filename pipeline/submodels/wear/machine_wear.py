"""Wear of a machine's tools: growth of forces, criterion, wear now."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.schema.si import N_MM2
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.twin.cut.coefficients import NOT_RECORDED, KnownWear, LandGrowth, MachineWear

if TYPE_CHECKING:
    from pipeline.submodels.wear.due import EdgeGrowth

NUMBER = re.compile(r"T?(\d+)", re.IGNORECASE)
"""Name of a tool that is its number."""


def machine_wear(models: Path) -> MachineWear:
    """Growth of the forces with wear, the criterion and the wear of tools in use of a machine."""
    folder = models / "wear"
    if not (folder / "model.json").exists():
        return MachineWear()
    from pipeline.submodels.wear.model import WearModel  # with Arrow, where there is such a model

    lasting = read_json(folder / "model.json", WearModel).lasting
    growth, reason = _growth(lasting.edges)
    return MachineWear(
        growth=growth,
        reason=reason if lasting.edges is not None or not lasting.reasons else lasting.reasons[-1],
        criterion_um=None if lasting.life is None else lasting.life.criterion_um,
        in_use=_in_use(folder / "verdict.json"),
    )


def _growth(edges: "EdgeGrowth | None") -> tuple[LandGrowth | None, str]:
    """The growth in SI, or why there is none."""
    if edges is None:
        return None, NOT_RECORDED
    from pipeline.submodels.wear.due import EDGE_NAMES

    found = []
    for name in EDGE_NAMES:
        one = edges.parameters[name]
        if one.value is None or one.interval_95 is None:
            return None, f"{NOT_RECORDED}: {one.method}"
        low, high = one.interval_95
        found.append((one.value * N_MM2, 0.5 * (high - low) * N_MM2))
    (K_te, half_te), (K_re, half_re) = found
    return LandGrowth(
        K_te=K_te, K_re=K_re, half_te=half_te, half_re=half_re, learnt_um=edges.wear_um,
        material=edges.material, basis=f"{edges.recordings} cuts with {edges.tools} tools",
    ), ""  # fmt: skip


def _in_use(path: Path) -> dict[int, KnownWear]:
    """Last reading of the flank wear of each tool in use, by its number."""
    if not path.exists():
        return {}
    from pipeline.submodels.wear.due import IN_USE, READ, READ_AT, TIME

    found = {}
    for case in read_json(path, Verdict).cases:
        number, read = NUMBER.fullmatch(case.case), case.facts.get(READ)
        if IN_USE not in case.facts or number is None or read is None:
            continue
        at, now = (
            case.facts[name].value if name in case.facts else None for name in (READ_AT, TIME)
        )
        if isinstance(read.value, int | float):
            found[int(number[1])] = KnownWear(
                wear_um=float(read.value),
                source=f"as last read, at {at} of its {now} min in the cut until now",
            )
    return found
