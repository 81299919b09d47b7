"""Data items of the simulated machines, for the log and the MTConnect Devices document (2.0)."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.files import replacing
from pipeline.shop.parameters import ShopParameters

Category = Literal["SAMPLE", "EVENT", "CONDITION"]
NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"


@dataclass(frozen=True)
class DataItem:
    """One data item; ``native = value * factor``, written with ``decimals`` digits after the point.

    ``native_units`` are those of ``units`` unless they are given.  ``supplied`` is False for items
    that the device model promises and the machine never sends.
    """

    name: str
    component: str
    category: Category
    type: str
    sub_type: str = ""
    units: str = ""
    native_units: str = field(default="", kw_only=True)
    factor: float = field(default=1.0, kw_only=True)
    decimals: int = field(default=0, kw_only=True)
    supplied: bool = field(default=True, kw_only=True)
    # sent as soon as the control is up, before the machine is ready
    at_start: bool = field(default=False, kw_only=True)

    def written(self, values: Floats | Ints, native: bool) -> Floats:
        """``values`` (T,) in ``units`` -> as the log has them, rounded; no negative zero."""
        return np.round(values * (self.factor if native else 1.0), self.decimals) + 0.0

    def texts(self, values: Floats | Ints, native: bool) -> list[str]:
        """Numbers as the log has them: whole ones without a point."""
        if self.decimals == 0 or (native and self.type == "EQUIPMENT_TIMER"):
            return [str(int(v)) for v in values.tolist()]
        return [f"{v:.10g}" for v in values.tolist()]


_MM, _MM_S, _PERCENT = "MILLIMETER", "MILLIMETER/SECOND", "PERCENT"
_MINUTELY: dict[str, Any] = {"native_units": "MILLIMETER/MINUTE", "factor": 60.0, "decimals": 3}
_TIMER: dict[str, Any] = {"native_units": "MINUTE", "factor": 1 / 60}


def _linear(axis: str) -> list[DataItem]:
    return [
        DataItem(f"{axis}pos", axis, "SAMPLE", "POSITION", "ACTUAL", _MM, decimals=4),
        DataItem(f"{axis}feed", axis, "SAMPLE", "AXIS_FEEDRATE", "ACTUAL", _MM_S, **_MINUTELY),
        DataItem(f"{axis}load", axis, "SAMPLE", "LOAD", "", _PERCENT),
        DataItem(f"{axis}travel", axis, "CONDITION", "POSITION"),
    ]


_ROTARY = [
    DataItem("Cang", "C", "SAMPLE", "ANGLE", "ACTUAL", "DEGREE", decimals=4),
    DataItem("Cvel", "C", "SAMPLE", "ANGULAR_VELOCITY", "", "DEGREE/SECOND",
             native_units="DEGREE/MINUTE", factor=60.0, decimals=4),
    DataItem("S1func", "C", "EVENT", "ROTARY_MODE"),
]  # fmt: skip

_SPINDLE = [
    DataItem("S1n", "C", "SAMPLE", "ROTARY_VELOCITY", "ACTUAL", "REVOLUTION/MINUTE"),
    DataItem("S1load", "C", "SAMPLE", "LOAD", "", _PERCENT),
    DataItem("S1temp", "C", "SAMPLE", "TEMPERATURE", "", "CELSIUS"),
    DataItem("spindle_c", "C", "CONDITION", "LOAD"),
    DataItem("S1temp_c", "C", "CONDITION", "TEMPERATURE"),
]

_PATH = [
    DataItem("prog", "path", "EVENT", "PROGRAM"),
    DataItem("exec", "path", "EVENT", "EXECUTION"),
    DataItem("opmode", "path", "EVENT", "CONTROLLER_MODE"),
    DataItem("ln", "path", "EVENT", "LINE_NUMBER", "INCREMENTAL"),
    DataItem("tool", "path", "EVENT", "TOOL_NUMBER"),
    DataItem("parts", "path", "EVENT", "PART_COUNT", "ALL"),
    DataItem("vpath", "path", "SAMPLE", "PATH_FEEDRATE", "ACTUAL", _MM_S, **_MINUTELY),
    DataItem("fovr", "path", "EVENT", "PATH_FEEDRATE_OVERRIDE", "PROGRAMMED", _PERCENT),
    DataItem("rovr", "path", "EVENT", "PATH_FEEDRATE_OVERRIDE", "RAPID", _PERCENT),
    DataItem("sovr", "path", "EVENT", "ROTARY_VELOCITY_OVERRIDE", "", _PERCENT),
    DataItem("t_auto", "path", "SAMPLE", "EQUIPMENT_TIMER", "WORKING", "SECOND", **_TIMER),
    DataItem("t_cut", "path", "SAMPLE", "EQUIPMENT_TIMER", "LOADED", "SECOND", **_TIMER),
    DataItem("t_total", "path", "SAMPLE", "EQUIPMENT_TIMER", "POWERED", "SECOND", **_TIMER),
    DataItem("motion_c", "path", "CONDITION", "MOTION_PROGRAM"),
]

_MACHINE = [
    DataItem("avail", "device", "EVENT", "AVAILABILITY", at_start=True),
    DataItem("estop", "controller", "EVENT", "EMERGENCY_STOP", at_start=True),
    DataItem("logic_c", "controller", "CONDITION", "LOGIC_PROGRAM", at_start=True),
    DataItem("system_c", "controller", "CONDITION", "SYSTEM", at_start=True),
    DataItem("coolant_c", "coolant", "CONDITION", "LEVEL", at_start=True),
    DataItem("lube_c", "lubrication", "CONDITION", "LEVEL", at_start=True),
    DataItem("pwr", "controller", "EVENT", "POWER_STATE"),
    DataItem("asset_chg", "device", "EVENT", "ASSET_CHANGED", supplied=False),
    DataItem("asset_rem", "device", "EVENT", "ASSET_REMOVED", supplied=False),
]


def data_items(c_axis: bool) -> list[DataItem]:
    """All data items of a machine in the order in which its adapter sends them."""
    linear = [item for axis in "XYZ" for item in _linear(axis)]
    return [*_MACHINE, *linear, *(_ROTARY if c_axis else []), *_SPINDLE, *_PATH]


def write_devices(path: Path, parameters: ShopParameters) -> None:
    """Write the device model of ``parameters.machine``."""
    ElementTree.register_namespace("", NAMESPACE)
    root = ElementTree.Element(_tag("MTConnectDevices"))
    ElementTree.SubElement(root, _tag("Header"), {
        "creationTime": f"{parameters.first_day}T00:00:00Z", "sender": "simulated-shop",
        "instanceId": "1", "version": "2.0.0.0", "bufferSize": "131072",
        "assetBufferSize": "1024", "assetCount": "0", "deviceModelChangeTime":
        f"{parameters.first_day}T00:00:00Z",
    })  # fmt: skip
    name = parameters.machine
    device = ElementTree.SubElement(
        ElementTree.SubElement(root, _tag("Devices")), _tag("Device"),
        {"id": name, "name": name, "uuid": f"simulated-{name}"},
    )  # fmt: skip
    description = {"manufacturer": "Simulated", "model": "motor spindle 15 kW"}
    ElementTree.SubElement(device, _tag("Description"), description).text = "simulated"
    _components(device, parameters)
    ElementTree.indent(root)
    with replacing(path) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _tag(name: str) -> str:
    return f"{{{NAMESPACE}}}{name}"


def _components(device: ElementTree.Element, parameters: ShopParameters) -> None:
    machine, items = parameters.machine, data_items(parameters.c_axis)
    _add_items(device, "device", machine, items)
    parts = ElementTree.SubElement(device, _tag("Components"))
    axes = ElementTree.SubElement(_child(parts, "Axes", machine, "axes"), _tag("Components"))
    for axis in "XYZ":
        _add_items(_child(axes, "Linear", machine, axis), axis, machine, items)
    _add_items(_child(axes, "Rotary", machine, "C"), "C", machine, items)
    controller = _child(parts, "Controller", machine, "controller")
    _add_items(controller, "controller", machine, items)
    paths = ElementTree.SubElement(controller, _tag("Components"))
    _add_items(_child(paths, "Path", machine, "path"), "path", machine, items)
    holder = _child(parts, "Systems", machine, "systems")
    systems = ElementTree.SubElement(holder, _tag("Components"))
    for element in ("Coolant", "Lubrication"):
        part = element.lower()
        _add_items(_child(systems, element, machine, part), part, machine, items)


def _child(
    parent: ElementTree.Element, element: str, machine: str, name: str
) -> ElementTree.Element:
    return ElementTree.SubElement(parent, _tag(element), {"id": f"{machine}-{name}", "name": name})


def _add_items(
    element: ElementTree.Element, component: str, machine: str, items: list[DataItem]
) -> None:
    holder = ElementTree.SubElement(element, _tag("DataItems"))
    for item in (i for i in items if i.component == component):
        attributes = {
            "category": item.category, "id": f"{machine}-{item.name}", "name": item.name,
            "type": item.type, "subType": item.sub_type, "units": item.units,
            "nativeUnits": item.native_units or item.units,
        }  # fmt: skip
        ElementTree.SubElement(holder, _tag("DataItem"), {k: v for k, v in attributes.items() if v})
