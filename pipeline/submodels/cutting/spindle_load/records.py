"""Records of a spindle's load: logs, their data items, and the programs that cut meanwhile."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Literal

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import stock_of
from pipeline.cutting.tool import Tool
from pipeline.gcode.setup import Setup
from pipeline.schema.ranges import Range, Ranged, Share
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
