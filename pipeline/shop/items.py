"""The data items of the simulated machines: one table for the log and for ``Devices.xml``."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Category = Literal["SAMPLE", "EVENT", "CONDITION"]


@dataclass(frozen=True, kw_only=True)
class Item:
    """One data item; ``native = value * factor``, written with ``decimals`` digits after the point.

    ``supplied`` is False for items that the device model promises and the machine never sends.
    """

    name: str
    component: str
    category: Category
    type: str
    sub_type: str = ""
    units: str = ""
    native_units: str = ""
    factor: float = 1.0
    decimals: int = 0
    supplied: bool = True
    at_start: bool = False  # said as soon as the control is up, before the machine is ready

    def written(self, values: np.ndarray, native: bool) -> np.ndarray:
        """``values`` (T,) in ``units`` -> as the log has them, rounded; no negative zero."""
        return np.round(values * (self.factor if native else 1.0), self.decimals) + 0.0


def _linear(axis: str) -> list[Item]:
    mm = "MILLIMETER"
    return [
        Item(name=f"{axis}pos", component=axis, category="SAMPLE", type="POSITION",
             sub_type="ACTUAL", units=mm, native_units=mm, decimals=4),
        Item(name=f"{axis}feed", component=axis, category="SAMPLE", type="AXIS_FEEDRATE",
             sub_type="ACTUAL", units=f"{mm}/SECOND", native_units=f"{mm}/MINUTE", factor=60.0,
             decimals=3),
        Item(name=f"{axis}load", component=axis, category="SAMPLE", type="LOAD", units="PERCENT",
             native_units="PERCENT"),
        Item(name=f"{axis}travel", component=axis, category="CONDITION", type="POSITION"),
    ]  # fmt: skip


_ROTARY = [
    Item(name="Cang", component="C", category="SAMPLE", type="ANGLE", sub_type="ACTUAL",
         units="DEGREE", native_units="DEGREE", decimals=4),
    Item(name="Cvel", component="C", category="SAMPLE", type="ANGULAR_VELOCITY",
         units="DEGREE/SECOND", native_units="DEGREE/MINUTE", factor=60.0, decimals=4),
    Item(name="S1func", component="C", category="EVENT", type="ROTARY_MODE"),
]  # fmt: skip

_SPINDLE = [
    Item(name="S1n", component="C", category="SAMPLE", type="ROTARY_VELOCITY", sub_type="ACTUAL",
         units="REVOLUTION/MINUTE", native_units="REVOLUTION/MINUTE"),
    Item(name="S1load", component="C", category="SAMPLE", type="LOAD", units="PERCENT",
         native_units="PERCENT"),
    Item(name="S1temp", component="C", category="SAMPLE", type="TEMPERATURE", units="CELSIUS",
         native_units="CELSIUS"),
    Item(name="spindle_c", component="C", category="CONDITION", type="LOAD"),
    Item(name="S1temp_c", component="C", category="CONDITION", type="TEMPERATURE"),
]  # fmt: skip


def _event(name: str, component: str, kind: str, **more: str) -> Item:
    return Item(name=name, component=component, category="EVENT", type=kind,
                sub_type=more.get("sub_type", ""), units=more.get("units", ""),
                native_units=more.get("units", ""))  # fmt: skip


def _timer(name: str, sub_type: str) -> Item:
    return Item(name=name, component="path", category="SAMPLE", type="EQUIPMENT_TIMER",
                sub_type=sub_type, units="SECOND", native_units="MINUTE",
                factor=1 / 60)  # fmt: skip


_PATH = [
    _event("prog", "path", "PROGRAM"),
    _event("exec", "path", "EXECUTION"),
    _event("opmode", "path", "CONTROLLER_MODE"),
    _event("ln", "path", "LINE_NUMBER", sub_type="INCREMENTAL"),
    _event("tool", "path", "TOOL_NUMBER"),
    _event("parts", "path", "PART_COUNT", sub_type="ALL"),
    Item(name="vpath", component="path", category="SAMPLE", type="PATH_FEEDRATE",
         sub_type="ACTUAL", units="MILLIMETER/SECOND", native_units="MILLIMETER/MINUTE",
         factor=60.0, decimals=3),
    _event("fovr", "path", "PATH_FEEDRATE_OVERRIDE", sub_type="PROGRAMMED", units="PERCENT"),
    _event("rovr", "path", "PATH_FEEDRATE_OVERRIDE", sub_type="RAPID", units="PERCENT"),
    _event("sovr", "path", "ROTARY_VELOCITY_OVERRIDE", units="PERCENT"),
    _timer("t_auto", "WORKING"),
    _timer("t_cut", "LOADED"),
    _timer("t_total", "POWERED"),
    Item(name="motion_c", component="path", category="CONDITION", type="MOTION_PROGRAM"),
]  # fmt: skip


def _early(name: str, component: str, category: Category, kind: str) -> Item:
    return Item(name=name, component=component, category=category, type=kind, at_start=True)


_MACHINE = [
    _early("avail", "device", "EVENT", "AVAILABILITY"),
    _early("estop", "controller", "EVENT", "EMERGENCY_STOP"),
    _early("logic_c", "controller", "CONDITION", "LOGIC_PROGRAM"),
    _early("system_c", "controller", "CONDITION", "SYSTEM"),
    _early("coolant_c", "coolant", "CONDITION", "LEVEL"),
    _early("lube_c", "lubrication", "CONDITION", "LEVEL"),
    _event("pwr", "controller", "POWER_STATE"),
    Item(name="asset_chg", component="device", category="EVENT", type="ASSET_CHANGED",
         supplied=False),
    Item(name="asset_rem", component="device", category="EVENT", type="ASSET_REMOVED",
         supplied=False),
]  # fmt: skip


def items(c_axis: bool) -> list[Item]:
    """All data items of a machine in the order in which its adapter sends them."""
    linear = [item for axis in "XYZ" for item in _linear(axis)]
    return [*_MACHINE, *linear, *(_ROTARY if c_axis else []), *_SPINDLE, *_PATH]
