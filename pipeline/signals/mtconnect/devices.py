"""The device model of an MTConnect agent: which data items a machine has, and in which units.

Read from a Devices document of any version (1.0 to 2.7) and namespace, or from a bare ``<Device>``
as vendors' templates hold, or from the JSON forms of both.  Source: ANSI/MTC1.4, part 2.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import pyarrow as pa

from pipeline.signals.mtconnect.text import Content, XmlEvents, content, local, quoted
from pipeline.signals.records import UnreadableFile


@dataclass(frozen=True, kw_only=True)
class DataItem:
    """One data item as its device declares it; None where the document says nothing.

    ``component`` is the element's name of the component that has the item (``Linear``),
    ``component_name`` what that component is called (``X``), ``source`` the name under which the
    adapter sends it, ``device`` the device that it belongs to, ``sample_rate`` in HERTZ.
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
    """How a device is called; ``label`` is the first of the others that no other device has."""

    label: str
    name: str | None
    uuid: str | None
    id: str | None

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
        """What ``data_item`` is in the observations: the item's name, or its id when it has none.

        With several devices the name alone may stand for two items: ``device:name``.
        """
        name = item.name or item.id
        return f"{item.device}:{name}" if self.several else name

    def find(self, key: str) -> DataItem | None:
        """The item called ``key``: by its name in observations, its name, its id or its source."""
        for index in (self._by_label, self._by_name, self._by_id, self._by_source):
            if key in index:
                return index[key]
        return None

    def by_id(self, item_id: str) -> DataItem | None:
        """The item whose id is ``item_id``; ids are unique in a document."""
        return self._by_id.get(item_id)

    @cached_property
    def _by_label(self) -> dict[str, DataItem]:
        return _first((self.item_name(i), i) for i in self.items)

    @cached_property
    def _by_name(self) -> dict[str, DataItem]:
        return _first((i.name, i) for i in self.items)

    @cached_property
    def _by_id(self) -> dict[str, DataItem]:
        return _first((i.id, i) for i in self.items)

    @cached_property
    def _by_source(self) -> dict[str, DataItem]:
        return _first((i.source, i) for i in self.items)


def _first(pairs: Iterable[tuple[str | None, DataItem]]) -> dict[str, DataItem]:
    found: dict[str, DataItem] = {}
    for key, item in pairs:
        if key:
            found.setdefault(key, item)
    return found


def device_of(said: dict[str, str], others: Iterable[Device]) -> Device:
    """A device from the attributes of its element, told apart from ``others`` by its label."""
    name, uuid, own_id = said.get("name"), said.get("uuid"), said.get("id")
    taken = {d.label for d in others}
    words = [w for w in (name, uuid, own_id) if w]
    free = [w for w in words if w not in taken]
    label = (free or words or ["?"])[0]
    return Device(label=label, name=name, uuid=uuid, id=own_id)


def data_item(said: dict[str, str], **where: str | None) -> DataItem:
    """A data item from the attributes of its element.

    Raises
    ------
    ValueError
        When it has no id: nothing in a stream could be told to be its own.
    """
    if not said.get("id"):
        raise ValueError("a data item has no id")
    return DataItem(
        id=said["id"],
        name=said.get("name") or None,
        category=_upper(said.get("category")),
        type=said.get("type"),
        sub_type=said.get("subType"),
        units=said.get("units"),
        native_units=said.get("nativeUnits"),
        native_scale=_number(said.get("nativeScale")),
        representation=_upper(said.get("representation")),
        sample_rate=_number(said.get("sampleRate")),
        **where,
    )


def _upper(word: str | None) -> str | None:
    return word.upper() if word else None


def _number(text: str | None) -> float | None:
    try:
        return float(text) if text else None
    except ValueError:
        return None


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

    def start(self, name: str, said: dict[str, str]) -> None:
        tag = local(name)
        parent = self._path[-1][0] if self._path else ""
        if tag != "fragment" and parent in ("", "fragment"):
            self.roots.append(tag)
        if parent == "Devices" or (tag == "Device" and parent in ("", "fragment")):
            self.devices.append(device_of(said, self.devices))
        if tag == "DataItem" and self._item is None:
            self._item, self._source = said, None
        elif tag == "Source" and self._item is not None:
            self._source = said.get("dataItemId")
            self._text.clear()
        self._path.append((tag, said))

    def characters(self, text: str) -> None:
        if self._path and self._path[-1][0] == "Source":
            self._text.append(text)

    def end(self, name: str) -> None:
        tag, said = self._path.pop()
        if tag == "Source" and self._item is not None:
            self._source = "".join(self._text).strip() or self._source
        elif tag == "DataItem" and said is self._item:
            self._keep(said)
            self._item = None

    def _keep(self, said: dict[str, str]) -> None:
        if not said.get("id"):
            return
        component, of = self._path[-2] if len(self._path) > 1 else ("", {})
        self.items.append(
            data_item(
                said,
                component=component or None,
                component_name=of.get("name") or of.get("id"),
                source=self._source,
                device=self.devices[-1].label if self.devices else None,
            )
        )


def read_devices(path: Path, device: str | None) -> DeviceModel:
    """The device model in the document at ``path``.

    Parameters
    ----------
    path : Path
        An MTConnectDevices document (XML or JSON), or a bare ``<Device>``.
    device : str or None
        Name, uuid or id of the device to keep; None keeps all.

    Raises
    ------
    UnreadableFile
        When it is no such document, breaks off, or has no such device.
    """
    whole = content(path)
    if whole.head(64).lstrip()[:1] in (b"{", b"["):
        from pipeline.signals.mtconnect.devices_json import model_of_json

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
    """The part of ``model`` that belongs to ``device`` (name, uuid or id); all of it for None.

    Raises
    ------
    UnreadableFile
        When no device is called so; the message names those there are.
    """
    if device is None:
        return model
    which = [d for d in model.devices if d.is_called(device)]
    if not which:
        there = ", ".join(d.label for d in model.devices)
        raise UnreadableFile(f"device {device!r} is not in this document, which has {there}")
    label = which[0].label
    items = tuple(i for i in model.items if i.device == label)
    return DeviceModel(items=items, devices=(which[0],))


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
