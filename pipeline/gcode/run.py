"""One interpretation under way: state, offsets, variables, rows written so far."""

from dataclasses import dataclass, field

from pipeline.gcode.block import Jump
from pipeline.gcode.contour import END, Contour, lay
from pipeline.gcode.moves import INCH, Frame, Kind, PathMode
from pipeline.gcode.offsets import Mapping, Offsets, offsets_of
from pipeline.gcode.rows import COLUMNS, Rows
from pipeline.gcode.setup import Setup
from pipeline.gcode.state import CANCELLED, DIALECTS, LINUXCNC, State

PATH_MODE = list(COLUMNS).index("path_mode")


@dataclass(slots=True)
class Cycle:
    """Words of a canned cycle, which stay in force until it is cancelled [mm, s].

    Parameters
    ----------
    code : int
        Ten times the G code; ``CANCELLED`` when none is in force.
    initial : float
        Coordinate along the plane's normal before the first block of the cycle.
    words : dict of str to float
        R, Z, Q, P … as last given, R and Z in program coordinates.
    """

    code: int = CANCELLED
    initial: float = 0.0
    words: dict[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class Register:
    """A number of the tool table while the program runs [mm]."""

    length: float = 0.0
    length_wear: float = 0.0
    radius: float = 0.0
    radius_wear: float = 0.0


@dataclass(slots=True, kw_only=True)
class Snapshot:
    """Modal state that M70 or M73 of LinuxCNC saved.

    Parameters
    ----------
    values : dict of str to number
        Fields of the state.
    length : list of 6 floats
        Tool offset.
    active : str
        Work coordinate system.
    automatic : bool
        M73: restored when the subroutine ends.
    """

    values: dict[str, float]
    length: list[float]
    active: str
    retract_to_r: bool
    automatic: bool

    @classmethod
    def of(cls, run: "Run", *, automatic: bool) -> "Snapshot":
        """What is in force now."""
        return cls(
            values={name: getattr(run.state, name) for name in SAVED},
            length=list(run.offsets.length),
            active=run.offsets.active,
            retract_to_r=run.retract_to_r,
            automatic=automatic,
        )

    def restore(self, run: "Run") -> None:
        """Put it in force again."""
        for name, value in self.values.items():
            setattr(run.state, name, value)
        run.offsets.length, run.offsets.active = list(self.length), self.active
        run.retract_to_r = self.retract_to_r
        run.remap()


SAVED = (
    "unit", "plane", "absolute", "arc_absolute", "feed_mode", "path_mode", "tolerance", "feed",
    "speed", "direction", "constant_surface_speed", "wcs",
)  # fmt: skip
"""What M70 saves of the state."""


class Run:
    """What the functions that carry out words work on.

    Parameters
    ----------
    setup : Setup
        The control before the program.
    capacity : int
        Rows to make room for.
    """

    def __init__(self, setup: Setup, capacity: int) -> None:
        self.setup = setup
        self.dialect = setup.dialect
        self.offsets: Offsets = offsets_of(setup)
        self.rows = Rows(capacity)
        self.state = _switched_on(setup)
        self.registers = {
            number: Register(length=tool.length, radius=tool.diameter / 2)
            for number, tool in setup.tools.items()
        }
        self.frames: dict[Frame, int] = {}
        self.files: list[str] = []
        self.mapping: Mapping = self.offsets.mapping()
        self.references = dict(setup.references)
        self.cycle = Cycle()
        self.contour: Contour | None = None
        self.beside: list[float] | None = None
        self.polar_angle: float | None = None
        self.modal_call: Jump | None = None
        self.saved: list[Snapshot | None] = [None]
        self.group_1 = 0
        self.retract_to_r = setup.dialect == "linuxcnc"
        self.length_mode = 490
        self.length_number = self.radius_number = 0
        self.pending_length = 0.0
        self.rigid = self.diameter = self.probed = self.waited = False
        self.remap()

    def remap(self) -> None:
        """Take over what was changed in ``offsets``."""
        self.mapping = self.offsets.mapping()
        frame = self.offsets.frame(self.mapping)
        self.state.frame = self.frames.setdefault(frame, len(self.frames))
        self.state.translation = self.mapping.translation
        self.state.transformed = int(
            self.mapping.matrix is not None
            or self.offsets.polar
            or self.diameter
            or self.modal_call is not None
        )

    @property
    def point(self) -> list[float]:
        """Where the program believes to stand [mm, deg]."""
        return self.mapping.program(self.state.position)

    def register(self, number: int) -> Register:
        """Entry of the tool table, made when it is not there."""
        return self.registers.setdefault(number, Register())

    def go(self, kind: Kind, line: int, end: list[float]) -> None:
        """A straight row to a machine position."""
        self.state.position = end
        self.beside = None
        self.rows.append(self.state, kind, line)

    def go_round(
        self, line: int, end: list[float], centre: tuple[float, float, float], angle: float
    ) -> None:
        """An arc to a machine position."""
        self.state.position = end
        self.beside = None
        self.rows.append(self.state, Kind.ARC, line, centre=centre, angle=angle)

    def stand(self, kind: Kind, line: int, *, code: int = 0, value: float = 0.0) -> None:
        """A row that does not move."""
        if self.beside is not None:
            programmed, self.state.position = self.state.position, self.beside
            self.rows.append(self.state, kind, line, code=code, value=value)
            self.state.position = programmed
            return
        self.rows.append(self.state, kind, line, code=code, value=value)

    def exact_stop(self) -> None:
        """G9: the last row ends standing still."""
        self.rows.arrays[PATH_MODE][self.rows.count - 1] = PathMode.EXACT_STOP

    def close_contour(self) -> None:
        """Lay the tool's path beside the contour that G41 or G42 opened."""
        contour, self.contour = self.contour, None
        self.state.compensation = 0
        if contour is not None and self.rows.count > contour.first:
            lay(contour, self.rows, self.dialect, self.files)
            last = self.rows.arrays[END][self.rows.count - 1].tolist()
            if last != self.state.position:
                self.beside = last


def _switched_on(setup: Setup) -> State:
    dialect = DIALECTS.index(setup.dialect)
    return State(
        position=list(setup.initial_position),
        unit=INCH if setup.inch else 1.0,
        dialect=dialect,
        motion=CANCELLED if dialect == LINUXCNC else 0,
    )
