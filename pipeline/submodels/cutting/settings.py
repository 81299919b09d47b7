"""Settings of the cutting sub-model: tool and dynamometer, recordings, spindle load, and fit."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Literal

import numpy as np

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import stock_of
from pipeline.cutting.tool import Tool
from pipeline.gcode.setup import Setup
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CHANNELS
from pipeline.schema.ranges import Positive, Range, Ranged, Share
from pipeline.search.genetic import GeneticSettings
from pipeline.signals.conditions import ConditionSources
from pipeline.submodels.contract import IntervalLimits
from pipeline.submodels.cutting.spindle_load.levels import LoadScale


@dataclass(frozen=True, kw_only=True)
class LoadItems:
    """Data items of the logs."""

    line: str
    """Line of the program's text that is executed, counting from 1."""
    speed: str
    """Data item of the spindle speed [rev/min]."""
    load: str
    """Data item of the spindle load [%]."""
    feed: str
    """Actual speed along the path [mm/s]."""


@dataclass(frozen=True, kw_only=True)
class LoadCut(Ranged, section="cutting_records.spindle.cuts"):
    """Logs of one program that cut a blank with flat or bull-nose end mills."""

    log: str
    """Pattern of their names below the machine's folder."""
    program: str
    """Path of the program there."""
    stock: str
    """Blank in the program's work coordinates, as
    :func:`pipeline.cutting.engagement.stock.stock_of` reads it; the path of an .stl file is one
    below the machine's folder."""
    tools: Mapping[int, Tool]
    """Cutting tools by their number in the program."""
    resolution_mm: Annotated[float, Range(least=0.01, most=10.0, unit="mm")] = 0.5
    """Resolution of the blank [mm]."""

    def __post_init__(self) -> None:
        stock_of(self.stock)
        super().__post_init__()
        for number, tool in self.tools.items():
            if tool.kind not in ("flat", "bull_nose"):
                raise ValueError(
                    f"cutting_records.spindle.cuts: tool {number} of {self.program} is a "
                    f"{tool.kind}: the width of its chip is not its depth, cut with an end mill "
                    "that is flat or bull_nose"
                )


@dataclass(frozen=True, kw_only=True)
class SpindleLoadRecords(Ranged, section="cutting_records.spindle"):
    """Logs from which no-load power and specific cutting force are identified, at least one."""

    items: LoadItems
    """Names of line, speed, load and feed in the logs."""
    drive: SpindleDrive
    """Rated power, base speed and efficiency that turn load into power; levels below its least
    speed do not count."""
    no_load: tuple[str, ...] = ()
    """Patterns of logs in which the spindle turns free throughout."""
    cuts: tuple[LoadCut, ...] = ()
    """Logs of programs that cut."""
    of: Literal["available", "rated"] = "available"
    """Meaning of 100 % load: the power available at that speed, or the rated power."""
    scale_error: Share = 0.1
    """Half of the 95 % interval of the power at the tool that a percent of load stands for, as a
    share: rated power, efficiency and meter together [1]."""
    settle_s: Annotated[float, Range(least=0.1, most=60.0, unit="s")] = 1.5
    """Time of constant speed and cut before a reading counts, five lags of the meter [s]."""
    setup: Setup = field(default_factory=Setup)
    """Set-up of the control, for the programs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.no_load and not self.cuts:
            raise ValueError(
                "cutting_records.spindle names no log: name those of the spindle turning free in "
                "no_load, those of programs that cut in cuts"
            )
        same = [getattr(self.items, item.name) for item in fields(self.items)]
        if len(set(same)) < len(same):
            raise ValueError(
                f"cutting_records.spindle.items are {', '.join(same)}: line, speed, load and feed "
                "are four data items"
            )

    @property
    def scale(self) -> LoadScale:
        """Conversion from a load in percent to power at the tool."""
        return LoadScale(drive=self.drive, of=self.of)


@dataclass(frozen=True, kw_only=True)
class CuttingFitSettings(Ranged, section="cutting_fit"):
    """Settings of the identification of cutting coefficients from forces."""

    method: Literal["least_squares", "genetic"] = "least_squares"
    """Optimiser whose optimum of the waveform's terms serves."""
    compare: bool = True
    """Whether the other method is run too, for the report."""
    harmonics: Annotated[int, Range(least=1, most=64)] = 48
    """Highest harmonic of the spindle's revolution that is used; those above 0.45 of the sampling
    rate are not."""
    zero_N: Annotated[float, Range(above=0.0, unit="N")] = 1.0
    """Standard deviation of a recording's zero [N] where the recording shows no air cutting."""
    widest: Positive = 0.5
    """Half of a 95 % interval, as a share of the value, beyond which it is undetermined [1]."""
    gain: Positive = 0.02
    """Share of the cross-validation error that a term must save to be kept [1]."""
    folds: Annotated[int, Range(least=2)] = 6
    """Folds of the cross-validation, at most; one or more recordings are left out at a time."""
    genetic: GeneticSettings = field(
        default_factory=lambda: GeneticSettings(population=16, generations=10, stall=5)
    )
    """Settings of the genetic algorithm."""


DIRECTIONS = ("feed", "normal", "axial")
"""Components of the force on the tool: along the feed, to the left of it, along the axis as F_z of
`cutting.waveform`."""


@dataclass(frozen=True, kw_only=True)
class Dynamometer:
    """Channels x, y, z of the force on the tool, each once; a minus before one reverses it."""

    feed: str = "-x"
    """Channel of the force on the tool along the feed, F_x of
    :mod:`pipeline.cutting.force.waveform`.  A dynamometer under the workpiece shows the opposite
    force: ``-x`` when its x points along the feed."""
    normal: str = "-y"
    """Channel of the force on the tool to the left of the feed, F_y; with M4, to the right."""
    axial: str = "z"
    """Channel of the force that lifts the workpiece, F_z: ``z`` of a dynamometer under the
    workpiece that points upwards."""

    def __post_init__(self) -> None:
        channels = [getattr(self, one) for one in DIRECTIONS]
        if sorted(one.removeprefix("-") for one in channels) != list(CHANNELS):
            raise ValueError(
                "cutting.dynamometer: feed, normal and axial are "
                f"{', '.join(map(repr, channels))}: name x, y and z, each once, a minus before "
                "those that are turned"
            )

    @property
    def rotation(self) -> Floats:
        """Forces on the tool (rows) from channels (columns); shape (3, 3), orthogonal."""
        matrix = np.zeros((3, 3))
        for row, name in enumerate(DIRECTIONS):
            channel = getattr(self, name)
            sign = -1.0 if channel.startswith("-") else 1.0
            matrix[row, CHANNELS.index(channel.removeprefix("-"))] = sign
        return matrix


@dataclass(frozen=True, kw_only=True)
class CuttingSetup:
    """Tool (an end mill), workpiece and dynamometer of a machine's cutting recordings."""

    tool: Tool
    """Tool of the cuts; its parameters in ``identified`` are identified."""
    material: str = ""
    """Material of the workpiece."""
    dynamometer: Dynamometer = field(default_factory=Dynamometer)
    """Orientation of its channels."""
    identified: tuple[Literal["runout", "helix"], ...] = ("runout",)
    """Unknowns of the tool that are identified; a given helix angle is the start of the search."""

    def __post_init__(self) -> None:
        if self.tool.kind == "drill":
            raise ValueError(
                "cutting.tool is a drill: coefficients are identified from the forces of end "
                "mills (flat, bull_nose or ball)"
            )


@dataclass(frozen=True, kw_only=True)
class CuttingLimits(IntervalLimits, section="cutting_limits"):
    """Limits on the error of predicted cutting forces."""

    peak_percent: Positive = 10.0
    mean_percent: Positive = 10.0
    """Greatest error of peak and mean force in the plane over a mean revolution [%]."""
    rms_percent: Positive = 20.0
    """Greatest RMS error of the waveform in the plane, over the RMS force [%]."""


Immersion = Literal["slot", "up", "down"]
CONDITION_UNITS: Mapping[str, str | None] = {
    "speed_rpm": "rev/min", "feed_mm_min": "mm/min", "feed_per_tooth_mm": "mm",
    "axial_depth_mm": "mm", "radial_depth_mm": "mm", "immersion": None, "entry_deg": "deg",
    "exit_deg": "deg", "cutting_time_min": "min",
}  # fmt: skip
"""Fields of :class:`StatedConditions` with their units; None for a word."""


@dataclass(frozen=True, kw_only=True)
class StatedConditions:
    """Cutting conditions as a person states them; None for what is not stated."""

    speed_rpm: float | None = None
    feed_mm_min: float | None = None
    feed_per_tooth_mm: float | None = None
    axial_depth_mm: float | None = None
    radial_depth_mm: float | None = None
    """Spindle speed [1/min], feed rate [mm/min], feed per tooth and depths of cut [mm]."""
    immersion: Immersion | None = None
    """Side of the tool that cuts."""
    entry_deg: float | None = None
    exit_deg: float | None = None
    """Entry and exit angle of the teeth (:mod:`pipeline.cutting.engagement.engagement`) [deg], in
    place of immersion and radial depth."""
    cutting_time_min: float | None = None
    """Time that the tool had cut since it was changed [min]; tells wear from other causes of an
    error."""

    @property
    def present(self) -> dict[str, float | str]:
        """Those that are stated, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class CuttingRecords:
    """Recordings of a machine's cutting forces (channels x, y, z) and of its spindle's load."""

    recordings: str = ""
    """Pattern of their names below the machine's folder; "" where there is no dynamometer."""
    channels: Mapping[str, str] = field(
        default_factory=lambda: {"x": "force_x", "y": "force_y", "z": "force_z"}
    )
    """x, y and z of the dynamometer by their names in the recordings."""
    name: str | None = None
    """Regular expression whose named groups are conditions in a recording's name."""
    conditions: StatedConditions = field(default_factory=StatedConditions)
    """Common to all recordings."""
    by_pattern: Mapping[str, StatedConditions] = field(default_factory=dict)
    """Conditions of the recordings whose names match a pattern."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Patterns of recordings that are not used, with the reason."""
    spindle: SpindleLoadRecords | None = None
    """Logs of the spindle's load."""

    def __post_init__(self) -> None:
        if sorted(self.channels) != list(CHANNELS):
            raise ValueError(
                f"cutting_records.channels has {', '.join(sorted(self.channels)) or 'none'}: name "
                "x, y and z"
            )
        if not self.recordings and self.spindle is None:
            raise ValueError(
                "cutting_records names neither recordings of a dynamometer nor logs of the "
                "spindle's load: write recordings or spindle"
            )

    @property
    def sources(self) -> ConditionSources:
        """Sources of the conditions of a recording."""
        return ConditionSources(
            everywhere=self.conditions.present, name=self.name, units=CONDITION_UNITS,
            section="cutting_records",
            by_pattern={pattern: one.present for pattern, one in self.by_pattern.items()},
        )  # fmt: skip
