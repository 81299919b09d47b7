"""Device model of an MTConnect agent: data items of a machine, and their units.

Read from a Devices document of any version (1.0 to 2.7) and namespace, or from a bare ``<Device>``
as vendors' templates hold, or from the JSON forms of both:

======================= ========================================================================
cppagent, jsonVersion 1 lists of ``{"Element": {...}}``
cppagent, jsonVersion 2 ``{"Element": [{...}, ...]}``, grouped by the element's name
MTConnect.NET           lists of plain objects, names in camel case, the element's name as ``type``
======================= ========================================================================

Source: ANSI/MTC1.4, part 2.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.signals.formats import RecordSource, UnreadableFile
from pipeline.signals.mtconnect.model import (
    DataItem,
    Device,
    DeviceModel,
    data_item,
    device_of,
    element_name,
)
from pipeline.signals.mtconnect.xml_events import Content, XmlEvents, content, local, quoted


class _Reader(XmlEvents):
    """Collects devices and data items from the elements as they come."""

    def __init__(self, content: Content) -> None:
        super().__init__(content)
        self.items: list[DataItem] = []
        self.devices: list[Device] = []
        self.roots: list[str] = []
        self._path: list[tuple[str, dict[str, str]]] = []
        self._item: dict[str, str] | None = None
        self._source: str | None = None
        self._text: list[str] = []

    def start(self, name: str, attributes: dict[str, str]) -> None:
        tag = local(name)
        parent = self._path[-1][0] if self._path else ""
        if tag != "fragment" and parent in ("", "fragment"):
            self.roots.append(tag)
        if parent == "Devices" or (tag == "Device" and parent in ("", "fragment")):
            self.devices.append(device_of(attributes, self.devices, is_agent=tag == "Agent"))
        if tag == "DataItem" and self._item is None:
            self._item, self._source = attributes, None
        elif tag == "Source" and self._item is not None:
            self._source = attributes.get("dataItemId")
            self._text.clear()
        self._path.append((tag, attributes))

    def characters(self, text: str) -> None:
        if self._path and self._path[-1][0] == "Source":
            self._text.append(text)

    def end(self, name: str) -> None:
        tag, attributes = self._path.pop()
        if tag == "Source" and self._item is not None:
            self._source = "".join(self._text).strip() or self._source
        elif tag == "DataItem" and attributes is self._item:
            self._keep(attributes)
            self._item = None

    def _keep(self, attributes: dict[str, str]) -> None:
        if not attributes.get("id"):
            return
        component, of = self._path[-2] if len(self._path) > 1 else ("", {})
        self.items.append(
            data_item(
                attributes,
                component=component or None,
                component_name=of.get("name") or of.get("id"),
                source=self._source,
                device=self.devices[-1].label if self.devices else None,
            )
        )


def read_devices(path: Path, device: str | None) -> DeviceModel:
    """Device model in a Devices document (XML or JSON) or a bare ``<Device>`` at ``path``.

    ``device`` is name, uuid or id of the one to keep; None keeps all.  Raises UnreadableFile.
    """
    whole = content(path)
    if whole.head(64).lstrip()[:1] in (b"{", b"["):
        return chosen(model_of_json(whole.everything()), device)
    reader = _Reader(whole)
    end = reader.parse_fragment()
    if not reader.devices:
        root = quoted(reader.roots[0]) if reader.roots else "nothing"
        raise UnreadableFile(f"no device is declared in this document, which is {root}")
    if end.reason:
        line = whole.line(end.at)
        raise UnreadableFile(f"the device document breaks off at line {line}: {end.reason}")
    return chosen(DeviceModel(items=tuple(reader.items), devices=tuple(reader.devices)), device)


def chosen(model: DeviceModel, device: str | None) -> DeviceModel:
    """The part of ``model`` that belongs to ``device`` (name, uuid or id); all of it for None."""
    if device is None:
        return model
    which = [d for d in model.devices if d.is_called(device)]
    if not which:
        there = ", ".join(d.label for d in model.devices)
        raise UnreadableFile(f"device {device!r} is not in this document, which has {there}")
    label = which[0].label
    items = tuple(i for i in model.items if i.device == label)
    return DeviceModel(items=items, devices=(which[0],))


def device_model(source: RecordSource, root: Path) -> DeviceModel | None:
    """The device model that ``source`` names, None when it names none."""
    if source.devices is None:
        return None
    try:
        return read_devices(root / source.devices, source.device)
    except UnreadableFile as error:
        reason = f"its device document {source.devices} cannot be read: {error}"
        raise UnreadableFile(reason) from None


Node = dict[str, Any]


def part(node: Any, *names: str) -> Any:
    """The member of ``node`` by the first name that it has, whatever the case of letters."""
    if isinstance(node, dict):
        for name in names:
            if name in node:
                return node[name]
        lowered = {key.lower(): key for key in node}
        for name in names:
            if name.lower() in lowered:
                return node[lowered[name.lower()]]
    return None


def named(node: Any) -> Iterator[tuple[str, Any]]:
    """Element name and body of each member in any form; the name is ``""`` where none stands."""
    if node == {}:
        return
    for group in node if isinstance(node, list) else [node]:
        if isinstance(group, dict) and _is_wrapped(group):
            for name, inside in group.items():
                for body in inside if isinstance(inside, list) else [inside]:
                    yield name, body
        elif group is not None:
            yield "", group


def _is_wrapped(group: Node) -> bool:
    """Whether an object only holds named elements; a plain element has at least one plain value."""
    return bool(group) and all(
        isinstance(v, dict) or (isinstance(v, list) and all(isinstance(x, dict) for x in v))
        for v in group.values()
    )


def bodies(node: Any, *names: str) -> Iterator[Node]:
    """The objects among the members of ``node`` that are elements called so, in any form."""
    for group in node if isinstance(node, list) else [node]:
        inside = [part(group, name) for name in names]
        found = [body for body in inside if body is not None] or [group]
        for body in found:
            members = body if isinstance(body, list) else [body]
            yield from (member for member in members if isinstance(member, dict))


def attributes_in(node: Node) -> dict[str, str]:
    """The plain values of an object as an element's attributes would hold them."""
    return {k: word(v) for k, v in node.items() if isinstance(v, (str, int, float))}


def word(value: Any) -> str:
    """A plain value as XML would write it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else "" if value is None else repr(value)


def model_of_json(text: bytes) -> DeviceModel:
    """Device model in a JSON document."""
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
    group = part(part(tree, "MTConnectDevices") or tree, "Devices")
    some = group if isinstance(group, list) else [group]
    agents = [agent for one in some for agent in bodies(part(one, "Agent"))]
    for device in devices:
        is_agent = part(device, "type") == "Agent" or device in agents
        known.append(device_of(attributes_in(device), known, is_agent=is_agent))
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
            attributes = attributes_in(item)
            if attributes.get("id"):
                yield data_item(
                    attributes,
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
