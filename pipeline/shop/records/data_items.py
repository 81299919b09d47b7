"""Data items of the simulated machines: one table for the log and for ``Devices.xml``.

The device model is an MTConnect Devices document (2.0).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.shop.parameters import ShopParameters

Category = Literal["SAMPLE", "EVENT", "CONDITION"]
NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"


@dataclass(frozen=True, kw_only=True)
class DataItem:
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
    at_start: bool = False  # sent as soon as the control is up, before the machine is ready

    def written(self, values: Floats | Ints, native: bool) -> Floats:
        """``values`` (T,) in ``units`` -> as the log has them, rounded; no negative zero."""
        return np.round(values * (self.factor if native else 1.0), self.decimals) + 0.0

    def texts(self, values: Floats | Ints, native: bool) -> list[str]:
        """Numbers as the log has them: whole ones without a point."""
        if self.decimals == 0 or (native and self.type == "EQUIPMENT_TIMER"):
            return [str(int(v)) for v in values.tolist()]
        return [f"{v:.10g}" for v in values.tolist()]


def _linear(axis: str) -> list[DataItem]:
    mm = "MILLIMETER"
    return [
        DataItem(name=f"{axis}pos", component=axis, category="SAMPLE", type="POSITION",
                 sub_type="ACTUAL", units=mm, native_units=mm, decimals=4),
        DataItem(name=f"{axis}feed", component=axis, category="SAMPLE", type="AXIS_FEEDRATE",
                 sub_type="ACTUAL", units=f"{mm}/SECOND", native_units=f"{mm}/MINUTE", factor=60.0,
                 decimals=3),
        DataItem(name=f"{axis}load", component=axis, category="SAMPLE", type="LOAD",
                 units="PERCENT", native_units="PERCENT"),
        DataItem(name=f"{axis}travel", component=axis, category="CONDITION", type="POSITION"),
    ]  # fmt: skip


_ROTARY = [
    DataItem(name="Cang", component="C", category="SAMPLE", type="ANGLE", sub_type="ACTUAL",
             units="DEGREE", native_units="DEGREE", decimals=4),
    DataItem(name="Cvel", component="C", category="SAMPLE", type="ANGULAR_VELOCITY",
             units="DEGREE/SECOND", native_units="DEGREE/MINUTE", factor=60.0, decimals=4),
    DataItem(name="S1func", component="C", category="EVENT", type="ROTARY_MODE"),
]  # fmt: skip

_SPINDLE = [
    DataItem(name="S1n", component="C", category="SAMPLE", type="ROTARY_VELOCITY",
                 sub_type="ACTUAL", units="REVOLUTION/MINUTE", native_units="REVOLUTION/MINUTE"),
    DataItem(name="S1load", component="C", category="SAMPLE", type="LOAD", units="PERCENT",
             native_units="PERCENT"),
    DataItem(name="S1temp", component="C", category="SAMPLE", type="TEMPERATURE", units="CELSIUS",
             native_units="CELSIUS"),
    DataItem(name="spindle_c", component="C", category="CONDITION", type="LOAD"),
    DataItem(name="S1temp_c", component="C", category="CONDITION", type="TEMPERATURE"),
]  # fmt: skip


def _event(name: str, component: str, kind: str, **more: str) -> DataItem:
    return DataItem(name=name, component=component, category="EVENT", type=kind,
                 sub_type=more.get("sub_type", ""), units=more.get("units", ""),
                 native_units=more.get("units", ""))  # fmt: skip


def _timer(name: str, sub_type: str) -> DataItem:
    return DataItem(name=name, component="path", category="SAMPLE", type="EQUIPMENT_TIMER",
                 sub_type=sub_type, units="SECOND", native_units="MINUTE",
                 factor=1 / 60)  # fmt: skip


_PATH = [
    _event("prog", "path", "PROGRAM"),
    _event("exec", "path", "EXECUTION"),
    _event("opmode", "path", "CONTROLLER_MODE"),
    _event("ln", "path", "LINE_NUMBER", sub_type="INCREMENTAL"),
    _event("tool", "path", "TOOL_NUMBER"),
    _event("parts", "path", "PART_COUNT", sub_type="ALL"),
    DataItem(name="vpath", component="path", category="SAMPLE", type="PATH_FEEDRATE",
             sub_type="ACTUAL", units="MILLIMETER/SECOND", native_units="MILLIMETER/MINUTE",
             factor=60.0, decimals=3),
    _event("fovr", "path", "PATH_FEEDRATE_OVERRIDE", sub_type="PROGRAMMED", units="PERCENT"),
    _event("rovr", "path", "PATH_FEEDRATE_OVERRIDE", sub_type="RAPID", units="PERCENT"),
    _event("sovr", "path", "ROTARY_VELOCITY_OVERRIDE", units="PERCENT"),
    _timer("t_auto", "WORKING"),
    _timer("t_cut", "LOADED"),
    _timer("t_total", "POWERED"),
    DataItem(name="motion_c", component="path", category="CONDITION", type="MOTION_PROGRAM"),
]  # fmt: skip


def _early(name: str, component: str, category: Category, kind: str) -> DataItem:
    return DataItem(name=name, component=component, category=category, type=kind, at_start=True)


_MACHINE = [
    _early("avail", "device", "EVENT", "AVAILABILITY"),
    _early("estop", "controller", "EVENT", "EMERGENCY_STOP"),
    _early("logic_c", "controller", "CONDITION", "LOGIC_PROGRAM"),
    _early("system_c", "controller", "CONDITION", "SYSTEM"),
    _early("coolant_c", "coolant", "CONDITION", "LEVEL"),
    _early("lube_c", "lubrication", "CONDITION", "LEVEL"),
    _event("pwr", "controller", "POWER_STATE"),
    DataItem(name="asset_chg", component="device", category="EVENT", type="ASSET_CHANGED",
             supplied=False),
    DataItem(name="asset_rem", component="device", category="EVENT", type="ASSET_REMOVED",
             supplied=False),
]  # fmt: skip


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
    path.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


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
            "nativeUnits": item.native_units,
        }  # fmt: skip
        ElementTree.SubElement(holder, _tag("DataItem"), {k: v for k, v in attributes.items() if v})
