"""A part program made better, by hand: aim and limits in; program, JSON and page out."""

import re
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import FrameType
from typing import Any, get_args

from pipeline.commands.cutting import (
    REMEDY,
    CutOptions,
    cut_job,
    cut_options,
    model_document,
    section,
)
from pipeline.commands.fleet import DATA
from pipeline.commands.programs import (
    Controlled,
    machine_control,
    program_at,
    setup_beside,
    write_document,
)
from pipeline.optimisation.document import optimised_document, optimised_text
from pipeline.optimisation.job import Job, Progress
from pipeline.optimisation.optimise import Result, optimise
from pipeline.optimisation.settings import CutLimit, Margins, Objective, OptimisationSettings
from pipeline.report.optimise_page import write_optimise_page
from pipeline.twin.drive_file import read_drives

Pair = tuple[float, float]

OPTION = {
    "limits.load_N": "--limit-load",
    "limits.deflection_um": "--limit-deflection",
    "limits.roughness_um": "--limit-roughness",
    "limits.torque_Nm": "--limit-torque",
    "limits.power_share": "--power-share",
    "limits.chip_um": "--chip",
    "limits.feed_mm_min": "--feed",
    "limits.speed_rpm": "--speed",
    "limits.cutting_speed_m_min": "--cutting-speed",
    "limits.least_speed_change_rpm": "--least-speed-change",
    "margins.stability": "--stability-margin",
    "certainty.epsilon": "--epsilon",
    "certainty.seed": "--seed",
    "search.seed": "--seed",
    "feed_mm_min": "--feed",
    "speed_rpm": "--speed",
    "chip_um": "--chip",
}
"""What a person writes for what the settings are called."""


@dataclass(frozen=True, kw_only=True)
class PartLimits:
    """Limits as the options give them; what is None is not limited, or as by default."""

    load: float | None = None
    deflection: float | None = None
    roughness: float | None = None
    torque: float | None = None
    power_share: float | None = None
    chip: Pair | None = None
    feed: Pair | None = None
    speed: Pair | None = None
    cutting_speed: Pair | None = None
    least_speed_change: float | None = None
    stability_margin: float | None = None

    def limits(self) -> CutLimit:
        """The limits of the part.

        Raises
        ------
        ValueError
            When one is out of its range; it names the option.
        """
        given = {
            "load_N": self.load, "deflection_um": self.deflection, "torque_Nm": self.torque,
            "roughness_um": self.roughness, "power_share": self.power_share, "chip_um": self.chip,
            "feed_mm_min": self.feed, "speed_rpm": self.speed,
            "cutting_speed_m_min": self.cutting_speed,
            "least_speed_change_rpm": self.least_speed_change,
        }  # fmt: skip
        with _named_as_options():
            margins = Margins()
            if self.stability_margin is not None:
                margins = Margins(stability=self.stability_margin)
            known = {name: value for name, value in given.items() if value is not None}
            return replace(CutLimit(margins=margins), **known)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How it is sought, as the options give it; what is None is as in conf/."""

    epsilon: float | None = None
    seed: int | None = None
    split: bool = False
    speeds: str | None = None
    proof_comment: bool = False

    def settings(self, parameters: Mapping[str, Any]) -> OptimisationSettings:
        """The section ``optimisation`` of ``parameters`` with what the options change.

        Raises
        ------
        ValueError
            When a value is out of its range; it names the option.
        """
        known = section(dict(parameters), "optimisation", OptimisationSettings)
        own = known or OptimisationSettings()
        if self.speeds not in (None, "own", "blocks"):
            raise ValueError(f"--speeds {self.speeds} is neither own nor blocks: name one of them")
        with _named_as_options():
            certainty, search, grouping = own.certainty, own.search, own.grouping
            if self.epsilon is not None:
                certainty = replace(certainty, epsilon=self.epsilon)
            if self.seed is not None:
                certainty = replace(certainty, seed=self.seed)
                search = replace(search, seed=self.seed)
            if self.speeds is not None:
                grouping = replace(grouping, speeds=self.speeds)  # type: ignore[arg-type]
            return replace(
                own, certainty=certainty, search=search,
                grouping=replace(grouping, split=self.split or grouping.split),
                proof_comment=self.proof_comment or own.proof_comment,
            )  # fmt: skip


@contextmanager
def _named_as_options() -> Iterator[None]:
    """Settings that are refused are told by the options that gave them."""
    try:
        yield
    except ValueError as error:
        named = re.sub(r"\b(?:\w+\.)?\w+( =)?", _option, str(error))
        raise ValueError(named) from error


def _option(found: re.Match[str]) -> str:
    name = found[0].removesuffix(" =")
    return OPTION.get(name, found[0])


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Files to write; a page and a JSON only where they are named."""

    program: Path
    json: Path | None = None
    page: Path | None = None

    @classmethod
    def of(cls, program: Path | None, json: Path | None, page: Path | None) -> "Outputs":
        """The files that were named.

        Raises
        ------
        ValueError
            When none is named for the program.
        """
        if program is None:
            raise ValueError(
                "--out is missing: name a file for the optimised program, as OPTIMISED.nc"
            )
        return cls(program=program, json=json, page=page)


def part_options(
    *, stock: str | None, tool_table: str | None, material: str | None, load: float | None,
    resolution: float | None, work_offset: str | None, frf: list[str] | None,
) -> CutOptions:  # fmt: skip
    """Blank, tools and material; all three are needed.

    Raises
    ------
    ValueError
        When one is missing, or a value is out of its range.
    """
    needed = {"stock": stock, "tool_table": tool_table, "material": material}
    for name, value in needed.items():
        if value is None:
            raise ValueError(f"--{name.replace('_', '-')} is missing: {REMEDY[name]}")
    found = cut_options(
        stock=stock, tool_table=tool_table, material=material, limit_load=load,
        resolution=resolution, work_offset=work_offset, frf=frf or (), page=None,
    )  # fmt: skip
    if found is None:
        raise ValueError("--stock is missing")
    return found


def objective_of(name: str) -> Objective:
    """The objective of that name.

    Raises
    ------
    ValueError
        When there is none.
    """
    known = get_args(Objective)
    if name not in known:
        raise ValueError(f"--objective {name} is none of {', '.join(known)}: name one of them")
    return name  # type: ignore[return-value]


@dataclass(frozen=True, kw_only=True)
class PartRequest:
    """Everything that ``kerf optimise`` is told, but where to write."""

    program: Path
    machine: str
    unit: str | None
    cut: CutOptions
    objective: Objective
    limits: PartLimits
    search: SearchOptions


def optimise_part(request: PartRequest, progress: Progress) -> tuple[Result, dict[str, Any]]:
    """The optimised program with its document.

    Raises
    ------
    ValueError
        When something named is not known, the program cannot be followed or cuts nothing, or no
        feed and speed keep the limits.
    KeyboardInterrupt
        When it was asked to end before anything kept the limits.
    """
    limits = request.limits.limits()
    on = machine_control(request.machine, request.unit)
    settings = request.search.settings(on.parameters)
    job = _job(request, on, limits, settings)
    with _named_as_options():
        result = optimise(job, progress)
    document = optimised_document(
        result, machine=request.machine, origin=on.origin, control=on.source
    )
    return result, document


def _job(
    request: PartRequest, on: Controlled, limits: CutLimit, settings: OptimisationSettings
) -> Job:
    program = program_at(request.program)
    cut, basis = cut_job(on, request.machine, request.cut)
    drives = DATA / "models" / request.machine / "drive.json"
    return Job(
        program=program, setup=setup_beside(on.setup, request.program), control=on.control,
        cut=cut, basis=basis, limits=limits, objective=request.objective, settings=settings,
        drives=read_drives(drives) if drives.exists() else {},
        identified=model_document(request.machine, "cutting.json"),
        judged=model_document(request.machine, "cutting_validation.json"),
    )  # fmt: skip


def write_optimised(result: Result, document: dict[str, Any], out: Outputs) -> list[Path]:
    """Write program, JSON and page; those that were written."""
    out.program.write_bytes(optimised_text(result))
    if out.json is not None:
        write_document(document, out.json)
    if out.page is not None:
        write_optimise_page(document, out.page, out.json)
    named = (getattr(out, item.name) for item in fields(out))
    return [path for path in named if path is not None]


@contextmanager
def interruptible(said: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Ctrl-C asks to end with the best so far instead of ending at once; a second one ends.

    Parameters
    ----------
    said : callable
        Called at the first.

    Yields
    ------
    callable
        Whether it was asked.
    """
    asked = False

    def first(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        said()

    before = signal.signal(signal.SIGINT, first)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)
