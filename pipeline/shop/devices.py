"""``Devices.xml``: the MTConnect Devices document (2.0) of a simulated machine."""

from pathlib import Path
from xml.etree import ElementTree

from pipeline.shop.items import Item, items
from pipeline.shop.parameters import ShopParameters

NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"


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
    machine, known = parameters.machine, items(parameters.c_axis)
    _data_items(device, "device", machine, known)
    parts = ElementTree.SubElement(device, _tag("Components"))
    axes = ElementTree.SubElement(_child(parts, "Axes", machine, "axes"), _tag("Components"))
    for axis in "XYZ":
        _data_items(_child(axes, "Linear", machine, axis), axis, machine, known)
    _data_items(_child(axes, "Rotary", machine, "C"), "C", machine, known)
    controller = _child(parts, "Controller", machine, "controller")
    _data_items(controller, "controller", machine, known)
    paths = ElementTree.SubElement(controller, _tag("Components"))
    _data_items(_child(paths, "Path", machine, "path"), "path", machine, known)
    holder = _child(parts, "Systems", machine, "systems")
    systems = ElementTree.SubElement(holder, _tag("Components"))
    for element in ("Coolant", "Lubrication"):
        part = element.lower()
        _data_items(_child(systems, element, machine, part), part, machine, known)


def _child(
    parent: ElementTree.Element, element: str, machine: str, name: str
) -> ElementTree.Element:
    return ElementTree.SubElement(parent, _tag(element), {"id": f"{machine}-{name}", "name": name})


def _data_items(
    element: ElementTree.Element, component: str, machine: str, known: list[Item]
) -> None:
    holder = ElementTree.SubElement(element, _tag("DataItems"))
    for item in (i for i in known if i.component == component):
        attributes = {
            "category": item.category, "id": f"{machine}-{item.name}", "name": item.name,
            "type": item.type, "subType": item.sub_type, "units": item.units,
            "nativeUnits": item.native_units,
        }  # fmt: skip
        ElementTree.SubElement(holder, _tag("DataItem"), {k: v for k, v in attributes.items() if v})
