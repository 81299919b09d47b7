"""Device models in the JSON forms of MTConnectDevices documents."""

from collections.abc import Iterator
from typing import Any

from pipeline.signals.mtconnect.devices import DataItem, Device, DeviceModel, data_item, device_of
from pipeline.signals.mtconnect.tree import Node, bodies, named, part, plain, word
from pipeline.signals.names import element_name
from pipeline.signals.records import UnreadableFile


def model_of_json(text: bytes) -> DeviceModel:
    """The model in a JSON document.

    Raises
    ------
    UnreadableFile
        When it is no JSON, or declares no device.
    """
    import orjson

    try:
        tree = orjson.loads(text)
    except orjson.JSONDecodeError as error:
        raise UnreadableFile(f"the device document is no JSON: {error}") from None
    devices = list(devices_of(tree))
    if not devices:
        raise UnreadableFile("no device is declared in this JSON document")
    known: list[Device] = []
    items: list[DataItem] = []
    for device in devices:
        known.append(device_of(plain(device), known))
        items += items_of(device, known[-1].label)
    return DeviceModel(items=tuple(items), devices=tuple(known))


def devices_of(tree: Any) -> Iterator[Node]:
    """The devices (and agents) of a document, or the device that ``tree`` itself is."""
    root = part(tree, "MTConnectDevices") or tree
    group = part(root, "Devices")
    if group is not None:
        yield from bodies(group, "Device", "Agent")
    elif part(root, "Device") is not None:
        yield from bodies(root, "Device")
    elif part(root, "DataItems") is not None or part(root, "Components") is not None:
        yield root


def items_of(device: Node, label: str | None) -> Iterator[DataItem]:
    """Data items of a device and of all that it is made of; those without id are left out."""
    waiting: list[tuple[str, Node]] = [("Device", device)]
    while waiting:
        tag, node = waiting.pop()
        for item in bodies(part(node, "DataItems"), "DataItem"):
            said = plain(item)
            if said.get("id"):
                yield data_item(
                    said,
                    component=tag,
                    component_name=word(part(node, "name") or part(node, "id")) or None,
                    source=_source(part(item, "Source")),
                    device=label,
                )
        inside = [
            (name or element_name(word(part(body, "type"))), body)
            for name, body in named(part(node, "Components"))
            if isinstance(body, dict)
        ]
        waiting += reversed(inside)


def _source(source: Any) -> str | None:
    if isinstance(source, dict):
        source = part(source, "value") or part(source, "dataItemId")
    return word(source) or None
