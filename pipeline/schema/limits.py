"""Limits of a part's cut: one type from the command line to the constraint and the document.

A limit's field holds its range with the unit, its name on pages, its margin and its option.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Annotated, Any, get_type_hints

from pipeline.schema.ranges import Range, Ranged

BY_TOOL = ("load_N", "deflection_um", "torque_Nm")
"""Limits that a tool may have of its own, ``limit_`` and the name in the tool table."""
ENDLESS = 1e12
"""Value from which on a limit counts as a mistake, in any unit."""


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Words for one limit."""

    option: str
    """Option on the command line."""
    help: str
    """Help of the option, one sentence."""
    name: str = ""
    """Name on pages; empty where it is no row of its own."""
    margin: str = ""
    """Field of :class:`Margins` that is kept free of it; empty where there is none."""


Margin = Annotated[float, Range(least=0.0, below=1.0)]
"""Share of a limit that is kept free [1]."""


@dataclass(frozen=True, kw_only=True)
class Margins(Ranged, section="margins"):
    """Shares of the limits that are kept free [1]: L (1 - margin) above, L (1 + margin) below."""

    load: Margin = 0.0
    power: Margin = 0.05
    torque: Margin = 0.05
    chip: Margin = 0.0
    deflection: Margin = 0.05
    stability: Annotated[
        float,
        Range(least=0.0, below=1.0),
        Limit(option="--stability-margin", help="Kept free of the lobes, a share."),
    ] = 0.1
    cutting_speed: Margin = 0.0
    roughness: Margin = 0.05
    axes: Margin = 0.05


@dataclass(frozen=True, kw_only=True)
class MachiningPractice(Ranged, section="practice"):
    """Machining practice for any part: greatest changes of F and S, and kept blocks."""

    change: Annotated[
        tuple[float, ...],
        Range(above=0.0, most=1e6),
        Limit(option="--change", help="F and S over those programmed, 0.5 1.5 by default."),
    ] = (0.5, 1.5)
    """F, S and the feed for each tooth over those programmed, least and greatest [1]; a tool's own
    ``change`` in the tool table goes first."""
    tool_life_min: Annotated[
        float,
        Range(least=0.0, below=ENDLESS, unit="min"),
        Limit(option="--tool-life", help="Least life of an edge where it is known, min."),
    ] = 15.0
    """Time in the cut that an edge lasts at least where its life is known [min]: makers' tables of
    cutting speeds are mostly for 15 min."""
    air_feed_mm_min: Annotated[
        float | None,
        Range(above=0.0, below=ENDLESS, unit="mm/min"),
        Limit(option="--air-feed", help="F of moves that cut nothing; as programmed by default."),
    ] = None
    """Greatest F of moves at feed that cut nothing [mm/min]; by default each as programmed."""
    keep: Annotated[
        tuple[str, ...],
        Limit(option="--keep", help="Keeps F and S: T5, lines 120-180, or a word of a comment."),
    ] = ()
    """Blocks that keep F and S: a tool as ``T5``, lines as ``120-180``, or a word in a comment or
    the name of a tool."""
    feed_step_mm_min: Annotated[
        float,
        Range(least=0.0, most=1e4, unit="mm/min"),
        Limit(option="--feed-step", help="F is a multiple of it, 10 mm/min by default."),
    ] = 10.0
    speed_step_rpm: Annotated[
        float,
        Range(least=0.0, most=1e4, unit="rev/min"),
        Limit(option="--speed-step", help="S is a multiple of it, 50 rev/min by default."),
    ] = 50.0
    """F and S are whole multiples of these, of a tenth of them below ten times that, and so on; 0
    leaves as many digits as are needed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_change("practice.change", self.change)


def check_change(name: str, change: tuple[float, ...]) -> None:
    """Refuse factors of change that are not two, about 1."""
    if len(change) != 2 or not change[0] <= 1.0 <= change[1]:
        raise ValueError(
            f"{name} = {list(change)} must be two numbers, the first at most 1 and the second at "
            "least 1"
        )


@dataclass(frozen=True, kw_only=True)
class CutLimit(Ranged, section="limits"):
    """Limits of a part's cut, in the units of tables; a limit that is None does not hold."""

    load_N: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="N"),
        Limit(option="--limit-load", help="Greatest load on a tool in the plane, N; or T5=300.",
              name="load across the tool’s axis", margin="load"),
    ] = None  # fmt: skip
    """Peak of the load across the tool's axis, for tools without their own [N]."""
    deflection_um: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="um"),
        Limit(option="--limit-deflection", help="Bending of a tool's tip, um; or T5=20.",
              name="deflection of the tip", margin="deflection"),
    ] = None  # fmt: skip
    """Deflection of the tool's tip, for tools without their own [um]."""
    roughness_um: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="um"),
        Limit(option="--limit-roughness", help="Height of the feed marks, um.",
              name="feed marks", margin="roughness"),
    ] = None  # fmt: skip
    """Height of the feed marks on walls and floors, R_t [um]."""
    chip_um: Annotated[
        tuple[float, ...] | None, Range(least=0.0, below=ENDLESS, unit="um"),
        Limit(option="--chip", help="Thickest chip of a block, um.",
              name="thickest chip", margin="chip"),
    ] = None  # fmt: skip
    """Least and greatest thickness of the thickest chip of a block [um]."""
    cutting_speed_m_min: Annotated[
        tuple[float, ...] | None, Range(least=0.0, below=ENDLESS, unit="m/min"),
        Limit(option="--cutting-speed", help="Cutting speed, m/min.",
              name="cutting speed", margin="cutting_speed"),
    ] = None  # fmt: skip
    """Least and greatest v_c [m/min]."""
    feed_mm_min: Annotated[
        tuple[float, ...] | None,
        Range(least=0.0, below=ENDLESS, unit="mm/min"),
        Limit(option="--feed", help="F, mm/min.", name="F"),
    ] = None
    """F [mm/min]; by default from a tenth of the program's least up to the fastest of the axes."""
    speed_rpm: Annotated[
        tuple[float, ...] | None,
        Range(least=0.0, below=ENDLESS, unit="rev/min"),
        Limit(option="--speed", help="S, rev/min.", name="S"),
    ] = None
    """S [rev/min]; by default the range of the spindle's drive."""
    torque_Nm: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="N m"),
        Limit(option="--limit-torque", help="Torque of the cut, N m; or T5=10.",
              name="torque of the cut", margin="torque"),
    ] = None  # fmt: skip
    """Torque of the cut, beside the drive's own, for tools without their own [N m]."""
    power_share: Annotated[
        float,
        Range(above=0.0, most=2.0),
        Limit(
            option="--power-share", help="Share of the drive's power that may be used.",
            name="share of the drive’s power", margin="power",
        ),
    ] = 1.0  # fmt: skip
    """Share of the drive's rated power [1]; above 1 for drives that bear it for minutes."""
    following_um: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="um"),
        Limit(option="--limit-following", help="Following error of an axis in the cut, um.",
              name="following error in the cut", margin="axes"),
    ] = None  # fmt: skip
    """Following error of an axis while the tool is in the material [um]."""
    motor_command_A: Annotated[
        float | None, Range(above=0.0, below=ENDLESS, unit="A"),
        Limit(option="--limit-motor-command", help="Command of an axis' motor in the cut, A.",
              name="motor command in the cut", margin="axes"),
    ] = None  # fmt: skip
    """Command of an axis' motor while the tool is in the material [A]."""
    least_speed_change_rpm: Annotated[
        float,
        Range(least=0.0, below=ENDLESS, unit="rev/min"),
        Limit(
            option="--least-speed-change", help="Between two S of a tool, rev/min.",
            name="least change of S",
        ),
    ] = 0.0  # fmt: skip
    """Least change of S between two blocks of one tool, unless it stays [rev/min]."""
    margins: Margins = field(default_factory=Margins)
    """Margins that are kept free of each limit."""
    practice: MachiningPractice = field(default_factory=MachiningPractice)
    """Greatest changes of F and S from the program."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, tuple) and not (len(value) == 2 and value[0] <= value[1] > 0):
                raise ValueError(
                    f"limits.{item.name} = {list(value)} must be two numbers, the least first"
                )

    @classmethod
    def of_options(cls, given: Mapping[str, Any]) -> "CutLimit":
        """Limits by the name of their field or margin; None leaves each at its default."""
        known: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in given.items()
            if value is not None
        }
        margins, practice = (
            {name: known.pop(name) for name in list(known) if name in _of(kind)}
            for kind in (Margins, MachiningPractice)
        )
        nested: dict[str, Any] = {
            "margins": Margins(**margins),
            "practice": MachiningPractice(**practice),
        }
        return replace(cls(**nested), **known)

    @property
    def given(self) -> dict[str, Any]:
        """Limits that hold, by the name of their field, and the margins."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


def limit_words(name: str) -> tuple[Limit, str]:
    """Words of the limit of one field of :class:`CutLimit`, and its unit."""
    return _of(CutLimit)[name]


def by_tool_words(of_part: float | None, own: Mapping[int, float | None], unit: str) -> str:
    """A limit of the part and the tools' own, by their number; empty where none is given."""
    given = [] if of_part is None else [f"{of_part:g} {unit}"]
    given += [f"T{tool} {value:g} {unit}" for tool, value in own.items() if value is not None]
    return ", ".join(given)


def limit_options() -> Iterator[tuple[str, Any, Limit]]:
    """Each limit that a command line may give: name of its field, type of its value, its words."""
    for kind in (CutLimit, Margins, MachiningPractice):
        for name, (words, _) in _of(kind).items():
            value = str(get_type_hints(kind)[name])
            several = list[str] if "str" in value or name in BY_TOOL else float
            yield name, tuple[float, float] if "tuple[float" in value else several, words


@cache
def _of(kind: type) -> dict[str, tuple[Limit, str]]:
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        extras = getattr(hint, "__metadata__", ())
        words = next((extra for extra in extras if isinstance(extra, Limit)), None)
        unit = next((extra.unit for extra in extras if isinstance(extra, Range)), "")
        if words is not None:
            found[name] = words, unit
    return found
