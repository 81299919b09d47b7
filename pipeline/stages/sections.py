"""Types of the sections of params.yaml, and the check of all of them at once."""

from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pipeline.cutting.economics.cost import EnergyParameters
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import TipModes
from pipeline.fleet import Fleet
from pipeline.parameters import RENAMED, section_path, structure
from pipeline.schema.decision import PromotionSettings
from pipeline.stages.__main__ import load_stage
from pipeline.stages.code import NO_STAGES
from pipeline.submodels.contract import submodels

BY_HAND: dict[str, Any] = {
    "spindle_drive": SpindleDrive,
    "dynamics": TipModes,
    "energy": EnergyParameters,
    "promotion": PromotionSettings,
}
"""Sections that no stage reads, only ``kerf simulate`` and ``promote``; their types."""


def section_types() -> dict[str, Any]:
    """The type of each section by its name, whether it stands at a machine or for all."""
    stages = {path.stem for path in Path(__file__).parent.glob("[a-z]*.py")} - NO_STAGES
    names = [*sorted(stages), *(f"identify_{one}" for one in submodels()),
             *(f"judge_{one}" for one in submodels())]  # fmt: skip
    found = dict(BY_HAND)
    for name in names:
        found |= load_stage(name).sections
    return found


def check(values: dict[str, Any]) -> None:
    """Check every section of every machine, and those for all, against their types."""
    types = section_types()
    for name in values:
        if name != "machine":
            _known(name, name, types)
            structure(values, name, types[name])
    machines = values.get("machine") or {}
    for machine, sections in machines.items():
        for name in sections or {}:
            path = f"machine.{machine}.{name}"
            _known(name, path, types)
            structure(values, path, types[name])
    fleet = structure(values, "fleet", Fleet)
    for one, names in fleet.submodels.items():
        for machine in names:
            for verb in ("identify", "judge"):
                for section, wanted in load_stage(f"{verb}_{one}").sections.items():
                    structure(values, section_path(values, section, machine), wanted)


def _known(name: str, path: str, types: dict[str, Any]) -> None:
    if name not in types:
        if (now := RENAMED.get(name)) in types:
            raise ValueError(f"section {path} is called {now} now: rename it in conf/")
        near = get_close_matches(name, types, 1)
        hint = f", did you mean {near[0]}?" if near else ":"
        raise ValueError(f"no stage reads section {path}{hint} correct or remove it in conf/")
