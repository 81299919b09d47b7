"""Job of an optimisation: a part program, its cut, and the models of its machine."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import stock_of
from pipeline.cutting.stability.tip_dynamics import TipDynamics, TipModes
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.errors import NO_BLOCK
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program, read_program
from pipeline.gcode.setup import Setup, setup_beside
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.operation_signs import named_operation
from pipeline.optimisation.settings import OptimisationSettings, Part
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import Objective
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.twin.cut.coefficients import (
    MachineWear,
    ToolWear,
    identified_coefficients,
    identified_no_load,
    tool_coefficients,
    worn_coefficients,
)
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import CutJob
from pipeline.twin.drive import IdentifiedDrive, read_drives
from pipeline.twin.program_axes import Residual

Progress = Callable[[str, float], bool]
"""Called with what is under way and the share that is done; True ends with the best so far."""


@dataclass(frozen=True, kw_only=True)
class MachineModels:
    """Models that were identified of a machine, as far as there are records."""

    control: ControlParameters
    """Control whose time counts."""
    drives: Mapping[str, IdentifiedDrive] = field(default_factory=dict)
    """Drives by axis."""
    cutting: CuttingModel | None = None
    """Identified cut."""
    verdicts: Mapping[str, Verdict | None] = field(default_factory=dict)
    """Verdicts by the name of each sub-model that was identified; None where it was not judged."""
    wear: MachineWear = field(default_factory=MachineWear)
    """Wear of the machine's tools."""
    residual: Residual | None = field(default=None, repr=False)
    """Network for what the drives leave over; None where it is not used."""
    residual_name: str = ""
    """Name of the residual's model."""

    @property
    def judged(self) -> Verdict | None:
        """Verdict on the cut."""
        return self.verdicts.get("cutting")


@dataclass(frozen=True, kw_only=True)
class Job:
    """One part on one machine."""

    program: Program = field(repr=False)
    """Program as written."""
    setup: Setup
    """Set-up of the machine."""
    models: MachineModels = field(repr=False)
    """Models that were identified of the machine."""
    cut: CutJob
    """Blank, tools and force laws."""
    basis: CutBasis
    """Prices, laws and limits of the cut."""
    limits: CutLimit
    """Limits of the part."""
    objective: Objective
    """Objective; ``pareto`` is all of the others that are known."""
    settings: OptimisationSettings = field(default_factory=OptimisationSettings)
    """Reliability, grouping, search."""
    catalogue: CuttingCatalogue | None = field(default=None, repr=False)
    """Cutting data by tool and operation; without it F and S are bounded by ``limits``
    alone."""
    moves: Moves = field(repr=False)
    """Moves of the program with ``setup``."""


class Interrupted(KeyboardInterrupt):
    """The search was ended before there was anything that keeps the limits."""


@dataclass(frozen=True, kw_only=True)
class Workshop:
    """Tools, material, prices and the spindle that a part is cut with."""

    table: ToolTable
    """Tools by number."""
    material: Material
    """Material of the blank."""
    rates: CostRates | None
    """Prices of time and electricity."""
    drive: SpindleDrive | None
    """Drive of the spindle."""
    drive_source: str
    """Origin of the drive's values."""
    energy: EnergyParameters | None
    """Power that the machine draws beside the cut."""
    dynamics: TipDynamics | TipModes | None
    """Dynamics of the tools' tips: as measured, or the machine's modes."""
    catalogue: CuttingCatalogue
    """Cutting data by tool and operation."""
    wear: ToolWear = field(default_factory=ToolWear)
    """Wear of the tools that was requested; where none was, the rule of the settings holds."""


def machine_models(
    folder: Path, control: ControlParameters, wear: MachineWear | None = None
) -> MachineModels:
    """Drives, cut and verdicts in ``data/champion/<machine>``, as far as there are."""
    drives, cutting = folder / "drive/model.json", folder / "cutting/model.json"
    return MachineModels(
        control=control,
        wear=wear or MachineWear(),
        drives=read_drives(drives) if drives.exists() else {},
        cutting=read_json(cutting, CuttingModel) if cutting.exists() else None,
        verdicts={
            path.parent.name: _verdict(path.with_name("verdict.json"))
            for path in (folder / "control/model.json", drives, cutting) if path.exists()
        },
    )  # fmt: skip


def _verdict(path: Path) -> Verdict | None:
    return read_json(path, Verdict) if path.exists() else None


@dataclass(frozen=True, kw_only=True)
class JobRequest:
    """A part of a machine as it was requested, by the stage or by a command."""

    program: Program
    """Program as written."""
    part: Part
    """Blank, tools, material, objective, limits."""
    workshop: Workshop
    """Tools, material, prices and the spindle."""
    models: MachineModels
    """Models that were identified of the machine."""
    setup: Setup
    """Set-up of the machine, with the folder of the program's subprograms."""
    settings: OptimisationSettings
    """Reliability, grouping, search."""
    moves: Moves
    """Moves of the program with ``setup``."""


def job_request(
    path: Path, part: Part, workshop: Workshop, models: MachineModels, *, setup: Setup,
    settings: OptimisationSettings, moves: Moves | None = None,
) -> JobRequest:  # fmt: skip
    """Request of the program at ``path``, whose subprograms may lie in its folder.

    ``moves``: those that it makes, where it was followed before.
    """
    if not path.is_file():
        raise ValueError(f"{path} is no file: name a part program")
    beside = setup_beside(setup, path)
    program = read_program(path)
    moves = interpret(program, beside) if moves is None else moves
    if len(moves) == 0:
        raise ValueError(NO_BLOCK.format(path.name))
    return JobRequest(
        program=program, part=part, workshop=workshop, models=models, setup=beside,
        settings=settings, moves=moves,
    )  # fmt: skip


def job_of(request: JobRequest, share: float = 1.0) -> Job:
    """Job of a request: its cut, and what that is evaluated by.

    ``share``: share of the criterion that tools are worn to [1].
    """
    part, workshop, models = request.part, request.workshop, request.models
    tools = {
        number: replace(tool, role="thread_mill")
        if not tool.role and named_operation(tool.name) == "thread_milling" else tool
        for number, tool in workshop.table.tools.items()
    }  # fmt: skip
    rule = workshop.wear.rule if workshop.wear.requested else request.settings.wear
    wear = replace(workshop.wear, machine=models.wear, rule=rule, share=share)
    identified = identified_coefficients(models.cutting)
    sharp = tool_coefficients(tools, part.material, workshop.material, identified)
    names = part.material, workshop.material.name
    coefficients = worn_coefficients(sharp, tools, wear, names)
    drive, source = spindle_drive(workshop.drive, workshop.drive_source, models.cutting)
    tips = workshop.dynamics
    cut = CutJob(
        stock=stock_of(part.stock), tools=tools,
        force_laws={number: one.law for number, one in coefficients.items()},
        resolution=part.resolution_mm * 1e-3, offsets=request.setup.work_offsets,
        offset=part.work_offset,
    )  # fmt: skip
    basis = CutBasis(
        stock=part.stock, table=part.tool_table, material=workshop.material,
        coefficients=coefficients, limit_load=part.limits.load_N, rates=workshop.rates,
        energy=workshop.energy, drive=drive, drive_source=source,
        dynamics=TipDynamics.of_modes(tips) if isinstance(tips, TipModes) else tips, wear=wear,
    )  # fmt: skip
    return Job(
        program=request.program, setup=request.setup, models=models, cut=cut, basis=basis,
        limits=part.limits, objective=part.objective, settings=request.settings,
        catalogue=workshop.catalogue, moves=request.moves,
    )  # fmt: skip


def spindle_drive(
    drive: SpindleDrive | None, source: str, cutting: CuttingModel | None
) -> tuple[SpindleDrive | None, str]:
    """The drive with the identified no-load power, if there is any, and its source."""
    idle = identified_no_load(cutting)
    if drive is None or idle is None:
        return drive, source
    return replace(drive, no_load_W=idle), f"{source}; no-load power identified on this machine"
