"""Which form the fields after an item's name have: from the Devices document, or not known."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pipeline.signals.names import is_name
from pipeline.signals.records import RecordSource

if TYPE_CHECKING:
    from pipeline.signals.mtconnect.devices import DataItem, DeviceModel

MOST_CACHED = 1 << 16
"""Names kept; a log of noise has more and does not fill the memory."""


class Plan(NamedTuple):
    """How the fields after one item's name are read.

    ``shape`` names the form; ``value * factor + offset`` is in the document's units; ``why`` says
    what keeps values from being converted, ``rate`` [Hz] is that of a time series.
    """

    name: str
    kind: str = "UNKNOWN"
    shape: str = "any"
    factor: float = 1.0
    offset: float = 0.0
    why: str = ""
    rate: float = 0.0


class Items:
    """The plans of a source's items.  The Devices document is read when the first is asked for."""

    def __init__(self, source: RecordSource, root: Path) -> None:
        self._source = source
        self._root = root
        self._plans: dict[str, Plan] = {}
        self._model: DeviceModel | None = None
        self._loaded = False

    def plan(self, key: str) -> Plan:
        """The plan for the item that the log calls ``key``, with or without ``device:``."""
        plan = self._plans.get(key)
        if plan is None:
            plan = self._plan(key)
            if len(self._plans) < MOST_CACHED:
                self._plans[key] = plan
        return plan

    def _plan(self, key: str) -> Plan:
        model = self._load()
        if model is None:
            return Plan(key)
        item = model.find(key) or (model.find(key.partition(":")[2]) if ":" in key else None)
        if item is None:
            return Plan(key)
        plan = Plan(model.item_name(item), *_form(item), rate=item.sample_rate or 0.0)
        native = self._source.values == "native" and plan.shape in ("sample", "position", "series")
        return _converted(plan, item) if native else plan

    def _load(self) -> "DeviceModel | None":
        if not self._loaded and self._source.devices:
            from pipeline.signals.mtconnect.devices import read_devices

            self._model = read_devices(self._root / self._source.devices, self._source.device)
        self._loaded = True
        return self._model


def _form(item: "DataItem") -> tuple[str, str]:
    """Kind and shape of a data item."""
    category, representation = item.category, item.representation or "VALUE"
    if category == "CONDITION":
        return "CONDITION", "condition"
    if representation in ("DATA_SET", "TABLE"):
        return representation, representation.lower()
    if category == "SAMPLE" and representation == "TIME_SERIES":
        return "TIME_SERIES", "series"
    if (item.units or "").endswith("_3D"):
        return category or "UNKNOWN", "position"
    if category == "SAMPLE":
        return "SAMPLE", "sample"
    if item.type in ("MESSAGE", "ALARM"):
        return "MESSAGE", item.type.lower()
    if item.type in ("ASSET_CHANGED", "ASSET_REMOVED"):
        return "EVENT", "asset_event"
    return "EVENT", "word" if is_name(item.type) else "event"


def _converted(plan: Plan, item: "DataItem") -> Plan:
    """The plan with factor and offset from native units."""
    from pipeline.signals.units import mtconnect_factor

    units = item.units or item.native_units or ""
    scale = 1.0 if item.native_scale is None else item.native_scale
    try:
        factor, offset = mtconnect_factor(item.native_units or units, units, scale)
    except ValueError as error:
        return plan._replace(shape="unconvertible", why=str(error))
    return plan._replace(factor=factor, offset=offset)
