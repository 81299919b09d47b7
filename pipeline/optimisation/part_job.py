"""From a part and the models of its machine to what is to be optimised."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import stock_of
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.program import read_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.job import Job
from pipeline.optimisation.part import Part, Parts
from pipeline.optimisation.settings import OptimisationSettings
from pipeline.twin.control import control_of_unit, read_controls
from pipeline.twin.cut import CutJob
from pipeline.twin.cut_coefficients import (
    identified_coefficients,
    identified_no_load,
    tool_coefficients,
)
from pipeline.twin.cut_document import CutBasis
from pipeline.twin.drive_file import IdentifiedDrive, read_drives

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class MachineModels:
    """What was identified of a machine; of what there are no records, nothing.

    Parameters
    ----------
    control : ControlParameters
        Whose time counts.
    drives : mapping of str to IdentifiedDrive
        By axis.
    cutting, judged : dict or None
        ``cutting.json`` and ``cutting_validation.json``.
    """

    control: ControlParameters
    drives: Mapping[str, IdentifiedDrive] = field(default_factory=dict)
    cutting: dict[str, Any] | None = None
    judged: dict[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class Catalogue:
    """What parts name: tool tables and materials, and what time and electricity cost."""

    tools: Mapping[str, ToolTable]
    materials: Mapping[str, Material]
    rates: CostRates


def machine_models(folder: Path, unit: str) -> MachineModels:
    """The models in ``data/models/<machine>``, with the control of ``unit``.

    Raises
    ------
    ValueError
        When there is no control, or a file is of another form.
    """
    drives = folder / "drive.json"
    return MachineModels(
        control=control_of_unit(read_controls(folder / "control.json"), unit),
        drives=read_drives(drives) if drives.exists() else {},
        cutting=_document(folder / "cutting.json"),
        judged=_document(folder / "cutting_validation.json"),
    )


def _document(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        found = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no JSON: run `dvc repro` to write it again") from error
    if not isinstance(found, dict):
        raise ValueError(f"{path} holds no object: run `dvc repro` to write it again")
    return found


def part_job(
    path: Path, part: Part, parts: Parts, models: MachineModels, catalogue: Catalogue,
    setup: Setup, settings: OptimisationSettings,
) -> Job:  # fmt: skip
    """The program at ``path`` as ``part`` wants it optimised.

    Raises
    ------
    ValueError
        When the program, the tool table or the material does not exist, or the blank is none.
    """
    if not path.is_file():
        raise ValueError(f"{path} does not exist: name a program of the machine in parts.programs")
    table = _named(catalogue.tools, part.tool_table, "tool")
    material = _named(catalogue.materials, part.material, "material")
    known = models.cutting or {}
    laws = tool_coefficients(table.tools, part.material, material, identified_coefficients(known))
    drive, source = spindle_drive(parts.drive, "section parts of the machine", known)
    modes = parts.dynamics
    return Job(
        program=read_program(path),
        setup=replace(setup, folders=(*setup.folders, path.resolve().parent)),
        control=models.control,
        cut=CutJob(
            stock=stock_of(part.stock), tools=table.tools,
            laws={number: one.law for number, one in laws.items()},
            resolution=part.resolution_mm * 1e-3, offsets=setup.work_offsets,
            offset=part.work_offset,
        ),
        basis=CutBasis(
            stock=part.stock, table=part.tool_table, material=material, laws=laws,
            limit_load=part.limits.load_N, rates=catalogue.rates, energy=parts.energy,
            drive=drive, drive_source=source,
            dynamics=None if modes is None else TipDynamics.of_modes(modes),
        ),
        limits=part.limits, objective=part.objective, settings=settings, drives=models.drives,
        identified=models.cutting, judged=models.judged,
    )  # fmt: skip


def spindle_drive(
    drive: SpindleDrive | None, source: str, cutting: Mapping[str, Any]
) -> tuple[SpindleDrive | None, str]:
    """The drive, with the no-load power of a ``cutting.json`` where one was identified.

    Returns
    -------
    SpindleDrive or None, str
        The drive, and where its values come from.
    """
    idle = identified_no_load(cutting)
    if drive is None or idle is None:
        return drive, source
    return replace(drive, no_load_W=idle), f"{source}; no-load power identified on this machine"


def _named(known: Mapping[str, T], name: str, folder: str) -> T:
    if name not in known:
        there = ", ".join(sorted(known)) or "none"
        raise ValueError(f"parts name {name!r}, which conf/{folder}/ does not have: it has {there}")
    return known[name]
