"""What is to be optimised: a program on a machine, its cut, what limits and what is known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.settings import CutLimit, Objective, OptimisationSettings
from pipeline.twin.cut import CutJob
from pipeline.twin.cut_document import CutBasis
from pipeline.twin.drive_file import IdentifiedDrive

Progress = Callable[[str, float], bool]
"""Told what is under way and which share of all is done; True asks to end with the best so far."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One part on one machine.

    Parameters
    ----------
    program : Program
        As written.
    setup : Setup
        Of the machine.
    control : ControlParameters
        Whose time counts.
    cut : CutJob
        Blank, tools and force laws.
    basis : CutBasis
        What a cut is judged by.
    limits : CutLimit
        Of the part.
    objective : str
        ``time``, ``cost``, ``energy``, ``wear`` or ``pareto``, all of these that are known.
    settings : OptimisationSettings
        How sure, which groups, how long to search.
    drives : mapping of str to IdentifiedDrive
        By axis; empty where none were identified.
    identified, judged : dict or None
        ``cutting.json`` and ``cutting_validation.json`` of the machine, where there are any.
    """

    program: Program = field(repr=False)
    setup: Setup
    control: ControlParameters
    cut: CutJob
    basis: CutBasis
    limits: CutLimit
    objective: Objective
    settings: OptimisationSettings = field(default_factory=OptimisationSettings)
    drives: Mapping[str, IdentifiedDrive] = field(default_factory=dict)
    identified: Mapping[str, Any] | None = field(default=None, repr=False)
    judged: Mapping[str, Any] | None = field(default=None, repr=False)


class Interrupted(KeyboardInterrupt):
    """The search was asked to end before there was anything that keeps the limits."""
