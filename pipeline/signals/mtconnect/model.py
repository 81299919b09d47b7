"""Vocabulary and device model of MTConnect: data items of a machine, and types that are names.

Source: ANSI/MTC1.4, part 2; MTConnect 2.x part 2 (types of events whose value is an identifier or
free text).
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from operator import attrgetter

import pyarrow as pa

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
