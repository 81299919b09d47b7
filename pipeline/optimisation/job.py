"""Job of an optimisation: a part program, its cut, and the models of its machine."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import stock_of
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program, read_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.operation_words import named_operation
from pipeline.optimisation.settings import OptimisationSettings, Part, Parts
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import Objective
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.twin.cut.coefficients import (
    identified_coefficients,
    identified_no_load,
    tool_coefficients,
)
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import CutJob
from pipeline.twin.cut.wear import ToolWear, worn_coefficients
from pipeline.twin.drive import IdentifiedDrive, read_drives
from pipeline.twin.program_axes import Residual

Progress = Callable[[str, float], bool]
"""Called with what is under way and the share that is done; True ends with the best so far."""
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class MachineModels:
    """Models that were identified of a machine, as far as there are records.

    Parameters
    ----------
    control : ControlParameters
        Whose time counts.
    drives : mapping of str to IdentifiedDrive
        By axis.
    cutting : CuttingModel or None
        The cut.
    verdicts : mapping of str to Verdict or None
        By the name of each sub-model that was identified; None where it was not judged.
    residual : Residual or None
        What the drives leave over; None where it is not asked for.
    residual_name : str
        Of its model.
    """

    control: ControlParameters
    drives: Mapping[str, IdentifiedDrive] = field(default_factory=dict)
    cutting: CuttingModel | None = None
    verdicts: Mapping[str, Verdict | None] = field(default_factory=dict)
    residual: Residual | None = field(default=None, repr=False)
    residual_name: str = ""

    @property
    def judged(self) -> Verdict | None:
        """The verdict on the cut."""
        return self.verdicts.get("cutting")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One part on one machine.

    Parameters
    ----------
    program : Program
        As written.
    setup : Setup
        Of the machine.
    models : MachineModels
        Identified of the machine.
    cut : CutJob
        Blank, tools and force laws.
    basis : CutBasis
        Prices, laws and limits of the cut.
    limits : CutLimit
        Of the part.
    objective : str
        ``pareto`` is all of the others that are known.
    settings : OptimisationSettings
        Reliability, grouping, search.
    catalogue : CuttingCatalogue, optional
        Of feeds and speeds by tool and operation; without it F and S are bounded by ``limits``
        alone.
    moves : Moves, optional
        Of the program with ``setup``, where it was followed before.
    """

    program: Program = field(repr=False)
    setup: Setup
    models: MachineModels = field(repr=False)
    cut: CutJob
    basis: CutBasis
    limits: CutLimit
    objective: Objective
    settings: OptimisationSettings = field(default_factory=OptimisationSettings)
    catalogue: CuttingCatalogue | None = field(default=None, repr=False)
    moves: Moves | None = field(default=None, repr=False)


class Interrupted(KeyboardInterrupt):
    """The search was ended before there was anything that keeps the limits."""


@dataclass(frozen=True, kw_only=True)
class Workshop:
    """Tools, material, prices and the spindle that a part is cut with.

    Parameters
    ----------
    table : ToolTable
        Tools by number.
    material : Material
        Of the blank.
    rates : CostRates, optional
        Prices of time and electricity.
    drive : SpindleDrive, optional
        Of the spindle.
    drive_source : str
        Where its values come from.
    energy : EnergyParameters, optional
        Power that the machine draws beside the cut.
    dynamics : TipDynamics, optional
        Of the tools' tips.
    catalogue : CuttingCatalogue
        Of feeds and speeds by tool and operation.
    wear : ToolWear
        That the tools are taken to have.
    """

    table: ToolTable
    material: Material
    rates: CostRates | None
    drive: SpindleDrive | None
    drive_source: str
    energy: EnergyParameters | None
    dynamics: TipDynamics | None
    catalogue: CuttingCatalogue
    wear: ToolWear = field(default_factory=ToolWear)


@dataclass(frozen=True, kw_only=True)
class Supplies:
    """Tool tables and materials by name, prices of time and electricity, cutting data."""

    tools: Mapping[str, ToolTable]
    materials: Mapping[str, Material]
    rates: CostRates
    cutting_data: CuttingCatalogue

    def workshop(self, part: Part, parts: Parts, wear: ToolWear) -> Workshop:
        """The workshop of one of the parts of a machine.

        Raises
        ------
        ValueError
            When its tool table or material does not exist.
        """
        modes = parts.dynamics
        return Workshop(
            table=_named(self.tools, part.tool_table, "tool"),
            material=_named(self.materials, part.material, "material"),
            rates=self.rates,
            drive=parts.drive,
            drive_source="section parts of the machine",
            energy=parts.energy,
            dynamics=None if modes is None else TipDynamics.of_modes(modes),
            catalogue=self.cutting_data,
            wear=wear,
        )


def machine_models(folder: Path, control: ControlParameters) -> MachineModels:
    """Drives, cut and verdicts in ``data/champion/<machine>``, as far as there are.

    Raises
    ------
    StoreError
        When a file is broken or of another form.
    """
    drives, cutting = folder / "drive/model.json", folder / "cutting/model.json"
    return MachineModels(
        control=control,
        drives=read_drives(drives) if drives.exists() else {},
        cutting=read_json(cutting, CuttingModel) if cutting.exists() else None,
        verdicts={
            path.parent.name: _verdict(path.with_name("verdict.json"))
            for path in (folder / "control/model.json", drives, cutting) if path.exists()
        },
    )  # fmt: skip


def _verdict(path: Path) -> Verdict | None:
    return read_json(path, Verdict) if path.exists() else None


def part_program(path: Path, setup: Setup) -> tuple[Program, Setup]:
    """The program at ``path``, and the set-up that also finds subprograms in its folder.

    Raises
    ------
    ValueError
        When it does not exist.
    """
    if not path.is_file():
        raise ValueError(f"{path} does not exist: name a program of the machine in parts.programs")
    return read_program(path), replace(setup, folders=(*setup.folders, path.resolve().parent))


def part_job(
    program: Program, part: Part, *, models: MachineModels, workshop: Workshop, setup: Setup,
    settings: OptimisationSettings, moves: Moves | None = None,
) -> Job:  # fmt: skip
    """A program with the limits and the objective of ``part``.

    Parameters
    ----------
    program : Program
        As written.
    part : Part
        Blank, objective, limits.
    models : MachineModels
        Identified of the machine.
    workshop : Workshop
        Tools, material, prices, spindle.
    setup : Setup
        Of the machine, with the folder of the program's subprograms.
    settings : OptimisationSettings
        Reliability, grouping, search.
    moves : Moves, optional
        As the job keeps them.

    Raises
    ------
    ValueError
        When the blank is none.
    """
    cut, basis = cut_of(part, workshop, models.cutting, setup)
    return Job(
        program=program, setup=setup, models=models, cut=cut, basis=basis, limits=part.limits,
        objective=part.objective, settings=settings, catalogue=workshop.catalogue, moves=moves,
    )  # fmt: skip


def cut_of(
    part: Part, workshop: Workshop, cutting: CuttingModel | None, setup: Setup
) -> tuple[CutJob, CutBasis]:
    """Cut of a part, and the prices, cutting coefficients and limits that it is evaluated by.

    Parameters
    ----------
    part : Part
        Blank, resolution, load limit.
    workshop : Workshop
        Tools, material, prices, spindle.
    cutting : CuttingModel or None
        Identified of the machine.
    setup : Setup
        Of the machine.

    Raises
    ------
    ValueError
        When the blank is none.
    """
    tools = {
        number: replace(tool, role="thread_mill")
        if not tool.role and named_operation(tool.name) == "thread_milling" else tool
        for number, tool in workshop.table.tools.items()
    }  # fmt: skip
    identified = identified_coefficients(cutting)
    sharp = tool_coefficients(tools, part.material, workshop.material, identified)
    names = part.material, workshop.material.name
    coefficients = worn_coefficients(sharp, tools, workshop.wear, names)
    drive, source = spindle_drive(workshop.drive, workshop.drive_source, cutting)
    job = CutJob(
        stock=stock_of(part.stock), tools=tools,
        force_laws={number: one.law for number, one in coefficients.items()},
        resolution=part.resolution_mm * 1e-3, offsets=setup.work_offsets,
        offset=part.work_offset,
    )  # fmt: skip
    basis = CutBasis(
        stock=part.stock, table=part.tool_table, material=workshop.material,
        coefficients=coefficients, limit_load=part.limits.load_N, rates=workshop.rates,
        energy=workshop.energy, drive=drive, drive_source=source, dynamics=workshop.dynamics,
        wear=workshop.wear,
    )  # fmt: skip
    return job, basis


def spindle_drive(
    drive: SpindleDrive | None, source: str, cutting: CuttingModel | None
) -> tuple[SpindleDrive | None, str]:
    """The drive, with the no-load power that was identified of the machine, if any.

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
