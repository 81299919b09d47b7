"""The cut of a program by hand: from options to loads, stability and cost."""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast, get_args

from pipeline.app.programs import Controlled, Simulated
from pipeline.app.tables import read_material, read_tools, section
from pipeline.cutting.catalogue import CuttingCatalogue
from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import DIRECTIONS, TipDynamics, TipModes
from pipeline.cutting.tool import ToolTable
from pipeline.optimisation.axis_limits import check_axes
from pipeline.optimisation.job import Workshop, cut_of, machine_models
from pipeline.optimisation.reliability.force_intervals import cut_ranges, force_intervals
from pipeline.optimisation.reliability.uncertainty import uncertainty
from pipeline.optimisation.settings import OptimisationSettings, Part
from pipeline.parameters import structure
from pipeline.schema.limits import BY_TOOL, CutLimit, limit_options
from pipeline.schema.part import Objective
from pipeline.schema.program_cut import ForceInterval, NotKnown, ProgramCut
from pipeline.submodels.wear.machine_wear import machine_wear
from pipeline.twin.cut.document import CutBasis, document_of
from pipeline.twin.cut.loads import Cut, CutJob, cut_program
from pipeline.twin.cut.wear import ToolWear, WearRule
from pipeline.twin.preflight import preflight_warnings

RESOLUTION = 0.2
"""Of the blank where none is said [mm]."""
AXES = "following error and motor command in the cut"
REMEDY = {
    "stock": "give the blank, box:X0,X1,Y0,Y1,Z0,Z1 in mm, cylinder:X,Y,DIAMETER,Z0,Z1 or an .stl",
    "tool_table": "name a table of conf/tool/ or a YAML file",
    "material": "name a material of conf/material/",
}


TOOL_VALUE = re.compile(r"[Tt]?(\d{1,9})=(\d{1,9}(?:\.\d*)?|\.\d+)")
"""Number of a tool and a value of it, as ``T5=300``."""
ToolLimits = Mapping[int, Mapping[str, Any]]
"""Fields of tools that options give, by the tool's number."""
LIMIT_OPTION = {name: words.option for name, _, words in limit_options()}
"""Option of the command line by the limit that it gives."""
OPTION = {"certainty.epsilon": "--epsilon", "certainty.seed": "--seed", "search.seed": "--seed"} | {
    known: option
    for name, option in LIMIT_OPTION.items()
    for known in (
        f"margins.{name}", f"practice.{name}", f"limits.{name}", f"tool.limit_{name}",
        *([name] if "_" in name else []),
    )
}  # fmt: skip
"""Option of the command line by the setting that it gives."""


def limits_given(given: Mapping[str, Any]) -> tuple[CutLimit, ToolLimits]:
    """The limits of a part by the names of their fields, and those of single tools.

    Raises
    ------
    ValueError
        When one is out of its range, or given twice; it names the option.
    """
    of_part, by_tool = dict(given), dict[int, dict[str, Any]]()
    for name, words in given.items():
        if name in BY_TOOL and words is not None:
            others, own = _by_tool(LIMIT_OPTION[name], words)
            of_part[name] = _of_all(LIMIT_OPTION[name], others)
            for number, value in own.items():
                by_tool.setdefault(number, {})[f"limit_{name}"] = value
    with named_as_options():
        return CutLimit.of_options(of_part), by_tool


def _by_tool(option: str, words: Sequence[str]) -> tuple[list[str], dict[int, float]]:
    """Words of an option that name no tool, and values by tool, as ``T5=300`` gives them."""
    others, values = [], dict[int, float]()
    for word in words:
        found = TOOL_VALUE.fullmatch(word)
        if found is None:
            others.append(word)
        elif int(found[1]) in values:
            raise ValueError(f"{option} gives T{int(found[1])} twice: leave one out")
        else:
            values[int(found[1])] = float(found[2])
    return others, values


def _of_all(option: str, words: Sequence[str]) -> float | None:
    """The one number of an option for all tools; None where none is given."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = [0.0, 0.0]
    if len(values) > 1:
        raise ValueError(
            f"{option} {' '.join(words)} is not one number: give one for all tools, and T5=300 "
            "for one of them"
        )
    return values[0] if values else None


@contextmanager
def named_as_options() -> Iterator[None]:
    """A setting that is refused is named by the option that gave it."""
    try:
        yield
    except ValueError as error:
        named = re.sub(r"\b(?:\w+\.)?\w+( =)?", _option_of, str(error))
        raise ValueError(named) from error


def _option_of(found: re.Match[str]) -> str:
    name = found[0].removesuffix(" =")
    return OPTION.get(name, found[0])


@dataclass(frozen=True, kw_only=True)
class WearOption:
    """What ``--wear`` says: a rule for all tools, None without one, and wear by tool [um]."""

    rule: WearRule | None = None
    given: Mapping[int, float] = field(default_factory=dict)

    @classmethod
    def of(cls, words: Sequence[str]) -> "WearOption":
        """The option as it was given, ``sharp``, ``criterion``, ``known`` or ``T26=120``.

        Raises
        ------
        ValueError
            When a word is none of them, or says a thing twice.
        """
        rules, given = _by_tool("--wear", words)
        for word in rules:
            if word not in get_args(WearRule):
                raise ValueError(
                    f"--wear {word} is no wear of a tool: give T26=120 for 120 um on T26, or one "
                    f"of {', '.join(get_args(WearRule))} for all tools"
                )
        if len(rules) > 1:
            raise ValueError(f"--wear {rules[1]} is given beside --wear {rules[0]}: give one")
        return cls(rule=cast(WearRule, rules[0]) if rules else None, given=given)


@dataclass(frozen=True, kw_only=True)
class CutOptions:
    """Options that describe a cut, of ``kerf simulate`` and ``kerf optimise``."""

    stock: str
    """Blank, see :func:`pipeline.cutting.engagement.stock.stock_of`."""
    tool_table: str
    """Name of a table of conf/tool/, or a YAML file."""
    material: str
    """Name of a material of conf/material/."""
    limits: CutLimit = field(default_factory=CutLimit)
    tool_limits: ToolLimits = field(default_factory=dict)
    """That the cut is held against, and those of single tools in place of the tool table's."""
    resolution: float = RESOLUTION
    """Resolution of the blank [mm]."""
    work_offset: str | None = None
    """That the blank is measured in."""
    frf: tuple[str, ...] = ()
    """Files of the frequency response at the tools' tips, ``x=TIP.csv`` or ``TIP.uff``."""
    wear: "WearOption" = field(default_factory=lambda: WearOption())
    """Wear of the tools."""

    def __post_init__(self) -> None:
        if not 0.001 <= self.resolution <= 100.0:
            raise ValueError(
                f"--resolution {self.resolution:g} mm is out of its range, 0.001 to 100: give the "
                "size of what counts on the part"
            )

    @property
    def files(self) -> tuple[Path, ...]:
        """What is read for the cut; no output may replace it."""
        named = [word for word in (self.stock, self.tool_table, self.material)
                 if word.lower().endswith((".stl", ".yaml", ".yml"))]  # fmt: skip
        return tuple(Path(word) for word in (*named, *(w.rpartition("=")[2] for w in self.frf)))


def cut_options(
    *, stock: str | None, tool_table: str | None, material: str | None,
    limits: Mapping[str, Any], resolution: float | None, work_offset: str | None,
    frf: Sequence[str], page: Path | None, wear: Sequence[str] = (),
) -> CutOptions | None:  # fmt: skip
    """The options of a cut, limits by the names of their fields; None where nothing is said of one.

    Raises
    ------
    ValueError
        When only a part of what a cut needs is said, or a value is out of its range.
    """
    needed = {"stock": stock, "tool_table": tool_table, "material": material}
    other = {LIMIT_OPTION[name].removeprefix("--"): value for name, value in limits.items()}
    other |= {
        "resolution": resolution,
        "work_offset": work_offset,
        "frf": frf or None,
        "wear": wear or None,
        "page": page,
    }
    said = [name for name, value in (needed | other | {"page": page}).items() if value is not None]
    if not said:
        return None
    for name, value in needed.items():
        if value is None:
            raise ValueError(f"{_option(said[0])} is given without {_option(name)}: {REMEDY[name]}")
    of_part, by_tool = limits_given(limits)
    return CutOptions(
        stock=str(stock), tool_table=str(tool_table), material=str(material),
        limits=of_part, tool_limits=by_tool, work_offset=work_offset, frf=tuple(frf),
        resolution=RESOLUTION if resolution is None else resolution, wear=WearOption.of(wear),
    )  # fmt: skip


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def cut_document(simulated: Simulated, machine: str, options: CutOptions) -> ProgramCut:
    """The cut of a simulated program, as it stands in the JSON of ``kerf simulate``.

    Raises
    ------
    ValueError
        When blank, tools or material are not known, or a cut has no tool.
    """
    job, basis = cut_job(simulated.on, machine, options)
    cut = cut_program(simulated.plan, job)
    document = document_of(cut, basis)
    drives = machine_models(simulated.on.models, simulated.on.control).drives
    axes = check_axes(cut, drives, residual=simulated.residual)
    forces = _force_intervals(cut, job, basis, simulated.on)
    unknown = [NotKnown(what=AXES, why=axes.reason)] if axes.reason else []
    warnings = (*preflight_warnings(simulated.checked.violations), *document.warnings)
    return replace(
        document, axes=axes.axes, forces=forces, not_known=(*document.not_known, *unknown),
        warnings=warnings,
    )  # fmt: skip


def _force_intervals(
    cut: Cut, job: CutJob, basis: CutBasis, on: Controlled
) -> tuple[ForceInterval, ...]:
    """Forces of each tool with 90 % intervals, by the draws of an optimisation's load limit."""
    models = machine_models(on.models, on.control)
    settings = section(dict(on.parameters), "optimisation", OptimisationSettings)
    certainty = (settings or OptimisationSettings()).certainty
    ranges = cut_ranges(cut)
    used = {number: basis.coefficients[number] for number in ranges}
    uncertain = uncertainty(
        used, job.tools, models.cutting, models.judged, certainty, ranges=ranges
    )  # fmt: skip
    return force_intervals(cut, uncertain, basis.coefficients, models.cutting, certainty.seed)


def cut_job(on: Controlled, machine: str, options: CutOptions) -> tuple[CutJob, CutBasis]:
    """The cut, and the prices, coefficients and limits that it is evaluated by.

    Raises
    ------
    ValueError
        When blank, tools or material are not known.
    """
    part = part_of(options, "time")
    known = machine_models(on.models, on.control).cutting
    return cut_of(part, workshop_of(on, machine, options), known, on.setup)


def part_of(options: CutOptions, objective: Objective, program: str = "part.nc") -> Part:
    """Blank, tools, material and limits of the options as a part with an objective."""
    return Part(
        program=program, name="part", stock=options.stock, tool_table=options.tool_table,
        material=options.material, objective=objective, limits=options.limits,
        resolution_mm=options.resolution, work_offset=options.work_offset,
    )  # fmt: skip


def workshop_of(
    on: Controlled, machine: str, options: CutOptions, rule: WearRule = "known"
) -> Workshop:
    """Tools, material, prices and spindle of the options and the machine's file.

    ``rule`` holds for the wear of tools where the options say nothing of it.

    Raises
    ------
    ValueError
        When tools or material are not known.
    """
    sections = on.parameters["machine"][machine]
    return Workshop(
        table=_limited(read_tools(options.tool_table), options.tool_limits),
        material=read_material(options.material),
        rates=section(on.parameters, "cost", CostRates),
        drive=section(sections, "spindle_drive", SpindleDrive),
        drive_source=f"conf/machine/{machine}.yaml",
        energy=section(sections, "energy", EnergyParameters),
        dynamics=_dynamics(sections, options.frf),
        catalogue=structure(on.parameters, "catalogue", CuttingCatalogue),
        wear=ToolWear(
            machine=machine_wear(on.models), rule=options.wear.rule or rule,
            asked=options.wear.rule is not None, given=options.wear.given,
        ),
    )  # fmt: skip


def _limited(table: ToolTable, given: ToolLimits) -> ToolTable:
    """The tool table with the limits that options give to single tools."""
    missing = sorted(given.keys() - table.tools.keys())
    if missing:
        there = ", ".join(f"T{number}" for number in sorted(table.tools))
        raise ValueError(
            f"a limit is given for T{missing[0]}, which the tool table does not have: it has "
            f"{there}"
        )
    with named_as_options():
        own = {number: replace(table.tools[number], **of) for number, of in given.items()}
    return replace(table, tools={**table.tools, **own})


def _dynamics(sections: dict[str, Any], frf: Sequence[str]) -> TipDynamics | None:
    """Modes of the tools' tips: of the option's response, else those of the machine's section."""
    if frf:
        from pipeline.cutting.stability.frf_file import read_frf
        from pipeline.cutting.stability.modal_fit import fit_modes
        from pipeline.cutting.stability.tip_dynamics import joined_responses

        parts = []
        for word in frf:
            direction, said, name = word.rpartition("=")
            path = Path(name)
            if not path.is_file():
                raise ValueError(
                    f"--frf {word}: {path} does not exist: name a frequency response, as "
                    "x=TIP.csv or TIP.uff"
                )
            parts.append(read_frf(path, direction=direction if said else None))  # type: ignore[arg-type]
        names = ", ".join(Path(word.rpartition("=")[2]).name for word in frf)
        whole = joined_responses(parts)
        if rigid := [d for k, d in enumerate(DIRECTIONS) if not whole.receptance[:, k, k].any()]:
            raise ValueError(
                f"--frf {names}: nothing is measured along {' and '.join(rigid)}, which would "
                f"count as rigid: give --frf {rigid[0]}=FILE too, the same file where the tip "
                "gives way alike"
            )
        try:
            fit = fit_modes(parts)
        except ValueError as error:
            raise ValueError(f"--frf {names}: {error}") from error
        return TipDynamics(
            source=f"modes fitted to the measured response {names}, error {100 * fit.error:.1f} %, "
            "taken for every tool",
            every=fit.modes, caution=fit.caution,
        )  # fmt: skip
    modes = section(sections, "dynamics", TipModes)
    return None if modes is None else TipDynamics.of_modes(modes)
