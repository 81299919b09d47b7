"""Device model of an MTConnect agent: data items of a machine, and their units.

Read from a Devices document of any version (1.0 to 2.7) and namespace, or from a bare ``<Device>``
as vendors' templates hold, or from the JSON forms of both:

======================= ========================================================================
cppagent, jsonVersion 1 lists of ``{"Element": {...}}``
cppagent, jsonVersion 2 ``{"Element": [{...}, ...]}``, grouped by the element's name
MTConnect.NET           lists of plain objects, names in camel case, the element's name as ``type``
======================= ========================================================================

Source: ANSI/MTC1.4, part 2; MTConnect 2.x part 2 (types of events whose value is an identifier or
free text).
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any

import pyarrow as pa

from pipeline.signals.formats import RecordSource, UnreadableFile
from pipeline.signals.mtconnect.xml_events import Content, XmlEvents, content, local, quoted

NAME_TYPES = frozenset([
    "ACTIVE_PROGRAM", "ASSET_CHANGED", "ASSET_REMOVED", "BLOCK", "FIXTURE_ASSET_ID", "FIXTURE_ID",
    "HARDWARE", "LINE_LABEL", "OPERATOR_ID", "PALLET_ID", "PART_GROUP_ID", "PART_ID",
    "PART_KIND_ID", "PART_NUMBER", "PART_SERIAL_NUMBER", "PART_UNIQUE_ID", "PROCESS_AGGREGATE_ID",
    "PROCESS_OCCURRENCE_ID", "PROGRAM", "PROGRAM_COMMENT", "PROGRAM_HEADER", "PROGRAM_LOCATION",
    "SERIAL_NUMBER", "TOOL_ASSET_ID", "TOOL_GROUP", "TOOL_ID", "USER", "WORKHOLDING_ID",
])  # fmt: skip
"""Types of events that are names: ``0012`` is the program 0012, not the number 12."""


def element_name(kind: str) -> str:
    """Name of a type's element: ``PATH_FEEDRATE`` becomes ``PathFeedrate``, ``x:FOO`` ``Foo``."""
    return "".join(word.capitalize() for word in kind.rpartition(":")[2].split("_"))


_ELEMENTS = frozenset(map(element_name, NAME_TYPES))


_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


def number_of(text: str) -> float | None:
    """The finite decimal number that ``text`` is, None for others (``nan``, ``1_0``, ``""``)."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def is_name(kind: str | None) -> bool:
    """Whether the values of an event are names, by type (``TOOL_ID``) or element (``ToolId``)."""
    if not kind:
        return False
    own = kind.rpartition(":")[2]
    return own in NAME_TYPES or own.removesuffix("Discrete") in _ELEMENTS


@dataclass(frozen=True, kw_only=True)
class DataItem:
    """Data item as its device declares it; None where the document is silent.

    ``component``: element's name (``Linear``), ``component_name``: its own (``X``), ``source``:
    name by the adapter, ``sample_rate`` in HERTZ.
    """

    id: str
    name: str | None = None
    category: str | None = None
    type: str | None = None
    sub_type: str | None = None
    units: str | None = None
    native_units: str | None = None
    native_scale: float | None = None
    representation: str | None = None
    component: str | None = None
    component_name: str | None = None
    source: str | None = None
    device: str | None = None
    sample_rate: float | None = None


@dataclass(frozen=True, kw_only=True)
class Device:
    """Names of a device; ``label`` is the first that no other device has.

    ``is_agent`` marks an agent's own device, which is no machine (MTConnect 1.7 on).
    """

    label: str
    name: str | None
    uuid: str | None
    id: str | None
    is_agent: bool = False

    def is_called(self, called: str) -> bool:
        """Whether ``called`` is its name, uuid or id."""
        return called in (self.name, self.uuid, self.id)


@dataclass(frozen=True, kw_only=True)
class DeviceModel:
    """The data items of one device, or of all devices of a document when none was chosen."""

    items: tuple[DataItem, ...]
    devices: tuple[Device, ...] = ()

    @property
    def several(self) -> bool:
        """Whether items of more than one device stand side by side."""
        return len(self.devices) > 1

    def item_name(self, item: DataItem) -> str:
        """Name of a data item in the observations, with several devices after ``device:``."""
        name = self.own_name(item)
        return f"{item.device}:{name}" if self.several else name

    def own_name(self, item: DataItem) -> str:
        """Its name; its id where it has none, or shares it with another item of its device."""
        shared = self._named[item.device, item.name] > 1
        return item.id if shared else item.name or item.id

    def find(self, key: str) -> DataItem | None:
        """The one item called ``key``; None where there is none, or there are several."""
        called = self.called(key)
        return called[0] if len(called) == 1 else None

    def called(self, key: str) -> tuple[DataItem, ...]:
        """Items called ``key``: by name in observations, name, id or source, or ``device:key``."""
        found = next((index[key] for index in self._indices if key in index), ())
        device, colon, own = key.partition(":")
        if found or not colon:
            return found
        labels = {d.label for d in self.devices if d.is_called(device)}
        return tuple(i for i in self.called(own) if i.device in labels)

    def by_id(self, item_id: str) -> DataItem | None:
        """The item whose id is ``item_id``; ids are unique in a document."""
        return next(iter(self._indices[2].get(item_id, ())), None)

    @cached_property
    def _named(self) -> Counter[tuple[str | None, str | None]]:
        return Counter((i.device, i.name) for i in self.items if i.name)

    @cached_property
    def _indices(self) -> tuple[dict[str, tuple[DataItem, ...]], ...]:
        """Items by name in observations, by name, by id and by source."""
        keys: list[Callable[[DataItem], str | None]] = [self.item_name]
        keys += [attrgetter(name) for name in ("name", "id", "source")]
        indices: list[dict[str, tuple[DataItem, ...]]] = []
        for key in keys:
            indices.append({})
            for item in self.items:
                if k := key(item):
                    indices[-1][k] = (*indices[-1].get(k, ()), item)
        return tuple(indices)


def device_of(
    attributes: dict[str, str], others: Iterable[Device], *, is_agent: bool = False
) -> Device:
    """A device from the attributes of its element, distinguished from ``others`` by its label."""
    name, uuid, own_id = attributes.get("name"), attributes.get("uuid"), attributes.get("id")
    taken = {d.label for d in others}
    words = [w for w in (name, uuid, own_id) if w]
    free = [w for w in words if w not in taken]
    label = (free or words or ["?"])[0]
    return Device(label=label, name=name, uuid=uuid, id=own_id, is_agent=is_agent)


def data_item(attributes: dict[str, str], **where: str | None) -> DataItem:
    """A data item from the attributes of its element; one without an id is a ValueError."""
    if not attributes.get("id"):
        raise ValueError("a data item has no id")
    return DataItem(
        id=attributes["id"],
        name=attributes.get("name") or None,
        category=_upper(attributes.get("category")),
        type=attributes.get("type"),
        sub_type=attributes.get("subType"),
        units=attributes.get("units"),
        native_units=attributes.get("nativeUnits"),
        native_scale=_number(attributes.get("nativeScale")),
        representation=_upper(attributes.get("representation")),
        sample_rate=_number(attributes.get("sampleRate")),
        **where,
    )


def _upper(word: str | None) -> str | None:
    return word.upper() if word else None


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        return None


def data_items_table(model: DeviceModel) -> pa.Table:
    """The model as a table, one row a data item; ``data_item`` is the name in observations."""
    columns: dict[str, pa.Array] = {
        "data_item": pa.array([model.item_name(i) for i in model.items], pa.string())
    }
    for field in fields(DataItem):
        numeric = field.name in ("native_scale", "sample_rate")
        values = [getattr(i, field.name) for i in model.items]
        columns[field.name] = pa.array(values, pa.float64() if numeric else pa.string())
    return pa.table(columns)


class _Tree(XmlEvents):
    """Elements as the JSON of cppagent's version 1 has them: ``{"Element": {...}}`` in lists."""

    def __init__(self, content: Content) -> None:
        super().__init__(content)
        self.roots: list[Node] = []
        self._path: list[tuple[str, Any]] = []

    def start(self, name: str, attributes: dict[str, str]) -> None:
        tag, own = local(name), attributes  # type: str, Any
        parent = self._path[-1][1] if self._path else self.roots
        if tag == "fragment":
            own = self.roots
        elif isinstance(parent, list):
            parent.append({tag: own})
        else:
            groups = ("Devices", "Components", "Compositions", "DataItems")
            own = parent.setdefault(tag, [] if tag in groups else attributes)
        self._path.append((tag, own))

    def characters(self, text: str) -> None:
        if self._path and self._path[-1][0] == "Source":
            self._path[-1][1]["value"] = self._path[-1][1].get("value", "") + text

    def end(self, name: str) -> None:
        self._path.pop()


def read_devices(path: Path, device: str | None) -> DeviceModel:
    """Device model in a Devices document (XML or JSON) or a bare ``<Device>`` at ``path``.

    ``device`` is name, uuid or id of the one to keep; None keeps all.  Raises UnreadableFile.
    """
    whole = content(path)
    if whole.head(64).lstrip()[:1] in (b"{", b"["):
        return chosen(model_of_json(whole.everything()), device)
    tree = _Tree(whole)
    end = tree.parse_fragment()
    names = [name for root in tree.roots for name in root]
    bare = [root for root in tree.roots if {"Device", "Agent"} & {*root}]
    model = _model({"Devices": next(_inside(tree.roots, "Devices"), bare)})
    if not model.devices:
        root = quoted(names[0]) if names else "nothing"
        raise UnreadableFile(f"no device is declared in this document, which is {root}")
    if end.reason:
        line = whole.line(end.at)
        raise UnreadableFile(f"the device document breaks off at line {line}: {end.reason}")
    return chosen(model, device)


def _inside(node: Any, name: str) -> Iterator[Any]:
    """Elements called so, wherever they stand in a tree of elements."""
    for one in node if isinstance(node, list) else [node]:
        for tag, body in one.items() if isinstance(one, dict) else ():
            yield from [body] if tag == name else _inside(body, name)


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
    model = _model(tree)
    if not model.devices:
        raise UnreadableFile("no device is declared in this JSON document")
    return model


def _model(tree: Any) -> DeviceModel:
    devices: list[Device] = []
    items: list[DataItem] = []
    group = part(part(tree, "MTConnectDevices") or tree, "Devices")
    some = group if isinstance(group, list) else [group]
    agents = [agent for one in some for agent in bodies(part(one, "Agent"))]
    for device in devices_of(tree):
        is_agent = part(device, "type") == "Agent" or device in agents
        devices.append(device_of(attributes_in(device), devices, is_agent=is_agent))
        items += items_of(device, devices[-1].label, "Agent" if device in agents else "Device")
    return DeviceModel(items=tuple(items), devices=tuple(devices))


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


def items_of(device: Node, label: str | None, kind: str = "Device") -> Iterator[DataItem]:
    """Data items of a device and of all that it is made of; those without id are left out."""
    waiting: list[tuple[str, Node]] = [(kind, device)]
    while waiting:
        tag, node = waiting.pop()
        for item in bodies(part(node, "DataItems"), "DataItem"):
            attributes = attributes_in(item)
            if attributes.get("id"):
                name = word(part(node, "name") or part(node, "id")) or None
                source = _source(part(item, "Source"))
                yield data_item(
                    attributes, component=tag, component_name=name, source=source, device=label
                )
        inside = [
            (name or element_name(word(part(body, "type"))), body)
            for group in ("Components", "Compositions")
            for name, body in named(part(node, group))
            if isinstance(body, dict)
        ]
        waiting += reversed(inside)


def _source(source: Any) -> str | None:
    if isinstance(source, dict):
        source = word(part(source, "value")).strip() or part(source, "dataItemId")
    return word(source) or None
