"""Control setup that a part program does not state: offsets, tool table, options of the control."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pipeline.schema.ranges import Range, Ranged

Vector = tuple[float, float, float, float, float, float]
"""X Y Z A B C [mm, deg]."""
ZERO: Vector = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Tool:
    """Entry of the tool table (or of the H and D registers)."""

    length: float = 0.0
    """Length of the tool, in register H [mm]."""
    diameter: float = 0.0
    """Diameter of the tool, in register D [mm]."""


@dataclass(frozen=True, kw_only=True)
class MachineLimits(Ranged, section="setup.limits"):
    """Limits of the machine; what is left out is not checked."""

    travel: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest position of an axis in machine coordinates, by its letter [mm, deg]."""
    spindle_rpm: Annotated[tuple[float, float], Range(least=0.0)] | None = None
    """Least and greatest speed of the spindle [rev/min]."""
    feed_mm_min: Annotated[tuple[float, float], Range(least=0.0)] | None = None
    """Least and greatest feed along the path [mm/min]."""
    tool_length_mm: Annotated[tuple[float, float], Range(least=0.0)] | None = None
    """Least and greatest length of a tool from the gauge line, as the changer takes it [mm]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := sorted(set(self.travel) - set("XYZABC")):
            raise ValueError(f"setup.limits.travel names {unknown[0]}: name X, Y, Z, A, B or C")
        named = {f"travel.{axis}": span for axis, span in self.travel.items()}
        named |= {name: span for name in ("spindle_rpm", "feed_mm_min", "tool_length_mm")
                  if (span := getattr(self, name)) is not None}  # fmt: skip
        for name, (low, high) in named.items():
            if not low < high:
                raise ValueError(
                    f"setup.limits.{name} = [{low:g}, {high:g}] must rise: write the least first"
                )


@dataclass(frozen=True, kw_only=True)
class Setup(Ranged, section="setup"):
    """The control as the operator left it before the program starts."""

    dialect: Literal["fanuc", "linuxcnc", "siemens"] = "fanuc"
    """``"fanuc"``, ``"linuxcnc"`` or ``"siemens"``."""
    work_offsets: Mapping[str, Vector] = field(default_factory=dict)
    """``"G54"`` … ``"G59"``, ``"G59.1"`` … (LinuxCNC), ``"G54.1 P1"`` … (Fanuc), ``"EXT"``, which
    lies under all of them [mm, deg]."""
    tools: Mapping[int, Tool] = field(default_factory=dict)
    """A number without an entry reads 0 on a Fanuc, as its registers do; LinuxCNC stops there."""
    tool_names: Mapping[str, int] = field(default_factory=dict)
    """Numbers of tools that a Siemens program calls by name; names that are not listed get the next
    free numbers in the order in which they are called."""
    references: Mapping[str, Vector] = field(default_factory=dict)
    """Reference positions of G28 and G30: ``"G28"``, ``"G30"``, ``"G30 P3"``, ``"G30 P4"`` [mm,
    deg]."""
    initial_position: Vector = ZERO
    """Position of the machine before the first block [mm, deg]."""
    inch: bool = False
    """Whether G20 is in force at the start."""
    inch_machine: bool = False
    """Whether a LinuxCNC machine counts inches, as its variables of offsets and tools then do
    (#5161 to #5410), whatever unit the program speaks."""
    decimal: Literal["calculator", "increment"] = "calculator"
    """Meaning of ``X10`` without a decimal point on a Fanuc: ``"calculator"`` 10 mm,
    ``"increment"`` 10 least input increments (0.001 mm, 0.0001 inch)."""
    peck_increments: bool | None = None
    """Whether Q of G73, G74, G76, G83, G84 and G87 counts least input increments where it has no
    decimal point, as Q5000 for 5 mm, though other words count millimetres; None asks where it would
    be more than the hole is deep."""
    parameters: Mapping[int | str, float] = field(default_factory=dict)
    """``#`` variables that have a value at the start, by number or name."""
    folders: tuple[Path, ...] = ()
    """Folders of subprograms that are not in the program's own file."""
    block_skip: tuple[int, ...] = ()
    """Levels of ``/`` that are switched on (1 is the plain ``/``)."""
    block_limit: Annotated[int, Range(least=1, finite=False, unit="blocks")] = 1_000_000
    """Blocks executed beyond its lines before a program counts as endless."""
    arc_tolerance: Annotated[float, Range(least=0.0, finite=False, unit="mm")] = 0.05
    """Radius at the end of an arc less the one at its start, on a Fanuc [mm]."""
    length_moves: bool = True
    """Whether a Fanuc G43 or G49 without an axis moves by the change of length, as it does unless
    parameter TOS (5006#6) is set; otherwise the coordinates shift."""
    peck_clearance: Annotated[float, Range(least=0.0, finite=False, unit="mm")] = 0.254
    """Gap that G83 keeps to the depth reached, and what G73 retracts by [mm]."""
    tapping_retract: Annotated[float | None, Range(least=0.0, finite=False, unit="mm")] = None
    """Retract of peck tapping (G74 and G84 with Q of a Fanuc) after each peck [mm] (parameters
    5200#5 = 0 and 5213); None goes back to R (5200#5 = 1)."""
    plain_m_codes: tuple[int, ...] = ()
    """M codes of a Fanuc that may have a P since it calls nothing; any other with a P is refused,
    but for M97, M98, M99 and M198."""
    boring_shift: str = "-Y"
    """Axis and sign in which G76 and G87 shift by Q, ``"+X"``, ``"-Y"``, … (parameter 5148)."""
    limits: MachineLimits = field(default_factory=MachineLimits)
    """Travel, spindle speeds, feeds and tool lengths that the machine has."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.dialect not in ("fanuc", "linuxcnc", "siemens"):
            raise ValueError(
                f"dialect is {self.dialect!r}: choose 'fanuc', 'linuxcnc' or 'siemens'"
            )
        if self.boring_shift not in BORING_SHIFTS:
            raise ValueError(
                f"boring_shift is {self.boring_shift!r}: choose one of {', '.join(BORING_SHIFTS)}"
            )
        if self.decimal not in ("calculator", "increment"):
            raise ValueError(f"decimal is {self.decimal!r}: choose 'calculator' or 'increment'")


BORING_SHIFTS = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")


def setup_beside(setup: Setup, path: Path) -> Setup:
    """The set-up that also finds subprograms in the program's folder."""
    return replace(setup, folders=(*setup.folders, path.resolve().parent))
