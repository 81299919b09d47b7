"""Reader of MTConnect JSON: the documents of cppagent (both versions) and of MTConnect.NET.

A file holds one document, one document a line, or lone observations, assets or data items as
agents publish them.  ``line`` of a rejection is the place of the record in the file.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.signals.formats import EXCERPT, Batch, RecordSource, UnreadableFile
from pipeline.signals.mtconnect.devices import (
    Node,
    attributes_in,
    bodies,
    device_model,
    devices_of,
    element_name,
    items_of,
    named,
    part,
    word,
)
from pipeline.signals.mtconnect.observations import (
    BLANK,
    SECTIONS,
    Entry,
    MalformedError,
    asset_shape,
    asset_time,
    shape_of,
)
from pipeline.signals.mtconnect.xml_events import content
from pipeline.signals.mtconnect.xml_observations import (
    RECORDS,
    Rows,
    Selection,
    device_name,
    foreign_reason,
    instance_of,
    selection,
)

_VALUES = ("value", "result", "samples", "entries")


def read(path: Path, source: RecordSource, root: Path) -> Iterator[Batch]:
    """Observations of the JSON documents in the file at ``path``, which is read as a whole."""
    trees, broken = _trees(content(path).everything())
    names = {device_name(attributes_in(d)) for tree in trees for d in _device_streams(tree)}
    chosen = selection(source, device_model(source, root), lambda: len(names) > 1)
    return _batches(_Reader(chosen), trees, broken)


def _trees(text: bytes) -> tuple[list[Any], list[tuple[int, str, str]]]:
    """Documents of a file, and the lines (line, reason, excerpt) that are none."""
    import orjson

    try:
        return [orjson.loads(text)], []
    except orjson.JSONDecodeError as error:
        whole = str(error)
    trees: list[Any] = []
    broken = []
    for number, line in enumerate(text.split(b"\n"), 1):
        if line.strip():
            try:
                trees.append(orjson.loads(line))
            except orjson.JSONDecodeError as error:
                excerpt = line[: 4 * EXCERPT].decode("utf-8", "replace")[:EXCERPT]
                broken.append((number, f"the line is no JSON: {error}", excerpt))
    if not any(isinstance(tree, (dict, list)) for tree in trees):
        raise UnreadableFile(f"the file is no JSON: {whole}")
    return trees, broken


def _batches(
    reader: "_Reader", trees: list[Any], broken: list[tuple[int, str, str]]
) -> Iterator[Batch]:
    known = False
    for tree in trees:
        for document in tree if isinstance(tree, list) else [tree]:
            for understood in reader.document(document):
                known = known or understood
                if reader.rows.read >= RECORDS:
                    yield reader.rows.batch()
    if not known:
        raise UnreadableFile("the JSON document is none of MTConnect")
    for line, reason, excerpt in broken:
        reader.rows.reject(line, reason, excerpt)
    yield reader.rows.batch()


def _device_streams(tree: Any) -> Iterator[Node]:
    root = part(tree, "MTConnectStreams") or tree
    # {"Streams": [{"DeviceStream": {...}}]} and {"Streams": {"DeviceStream": [...]}}
    yield from bodies(part(root, "Streams"), "DeviceStream")


class _Reader:
    """Fills rows from documents."""

    def __init__(self, selection: Selection) -> None:
        self.rows = Rows()
        self._selection = selection
        self._instance: int | None = None
        self._created: str | None = None

    def document(self, tree: Any) -> Iterator[bool]:
        """Read one document; yields whether it was understood, now and then."""
        if not isinstance(tree, dict):
            yield from self._unknown(tree)
            return
        root = part(tree, "MTConnectStreams", "MTConnectAssets", "MTConnectError") or tree
        header = part(root, "Header")
        attributes = attributes_in(header) if isinstance(header, dict) else {}
        self._instance = instance_of({k[:1].lower() + k[1:]: v for k, v in attributes.items()})
        self._created = word(part(header, "creationTime")) or None
        if part(root, "Streams") is not None:
            yield True
            for stream in _device_streams(tree):
                yield from self._device_stream(stream)
        elif part(root, "Assets") is not None:
            for tag, asset in named(part(root, "Assets")):
                self._asset(tag, asset)
            yield True
        elif part(root, "Errors", "Error") is not None:
            self._errors(root)
            yield True
        else:
            yield from self._lone(tree)

    def _lone(self, tree: Node) -> Iterator[bool]:
        devices = list(devices_of(tree))
        if devices or "MTConnectDevices" in tree:
            self.rows.read += sum(1 for device in devices for _ in items_of(device, None))
        elif "dataItemId" in tree and "timestamp" in tree:
            section = "CONDITION" if "level" in tree else "UNKNOWN"
            self._observation(section, "", tree, "?")
        elif "assetId" in tree:
            self._asset("", tree)
        elif "category" in tree and "id" in tree:
            self.rows.read += 1
        else:
            yield from self._unknown(tree)
            return
        yield True

    def _unknown(self, tree: Any) -> Iterator[bool]:
        self._reject("the JSON document is none of MTConnect", tree)
        yield False

    def _reject(self, reason: str, attributes: Any) -> None:
        import orjson

        try:
            excerpt = orjson.dumps(attributes)[: 4 * EXCERPT].decode("utf-8", "replace")
        except orjson.JSONEncodeError:  # nested too deeply
            excerpt = ""
        self.rows.reject(self.rows.place, reason, excerpt)

    # Streams ------------------------------------------------------------------------------------

    def _device_stream(self, stream: Node) -> Iterator[bool]:
        attributes = attributes_in(stream)
        device = device_name(attributes)
        if not self._selection.wants(attributes):
            self._reject(foreign_reason(device), attributes)
            return
        components = part(stream, "ComponentStreams", "ComponentStream")
        for component in bodies(components, "ComponentStream"):
            for key, section in SECTIONS.items():
                for tag, body in named(part(component, key)):
                    self._observation(section, tag, body, device)
            yield True

    def _observation(self, section: str, tag: str, body: Any, device: str) -> None:
        try:
            if not isinstance(body, dict):
                raise MalformedError("the observation is no JSON object")
            attributes = {k: v for k, v in body.items() if k not in _VALUES and v is not None}
            stamps = (attributes.pop(name, None) for name in ("timestamp", "sequence"))
            timestamp, sequence = (None if one is None else word(one) for one in stamps)
            tag = tag.rpartition(":")[2] or _tag(section, attributes, body)
            shape = shape_of(section, tag, attributes, device, self._selection.naming)
            self.rows.record(shape, timestamp, sequence, self._instance, _value(body))
        except MalformedError as malformed:
            self._reject(str(malformed), body)

    # Assets and errors --------------------------------------------------------------------------

    def _asset(self, tag: str, asset: Any) -> None:
        try:
            if not isinstance(asset, dict) or not part(asset, "assetId"):
                raise MalformedError("the asset has no assetId")
            time = asset_time(word(part(asset, "timestamp")) or self._created)
            naming, device = self._selection.naming, word(part(asset, "deviceUuid"))
            shape = asset_shape(device, word(part(asset, "assetId")), {"json": asset}, naming)
            kind = tag or word(part(asset, "type")) or "Asset"
            self.rows.add(shape, time, self._instance, kind)
        except MalformedError as malformed:
            self._reject(str(malformed), asset)

    def _errors(self, root: Node) -> None:
        for tag, error in named(part(root, "Errors", "Error")):
            code = word(part(error, "errorCode")) or tag
            message = part(error, "ErrorMessage", "value", "message")
            if isinstance(message, dict):
                message = part(message, "value")
            text = word(message) if isinstance(message, (str, int, float)) else ""
            self._reject(f"the agent answered {code}: {text}", error)


def _tag(section: str, attributes: Node, body: Node) -> str:
    """The element's name that a plain observation would have; its type is no attribute then."""
    if section == "CONDITION":
        return word(attributes.pop("level", "")).capitalize()
    tag = element_name(word(attributes.pop("type", "")))
    if "samples" in body:
        return f"{tag}TimeSeries"
    entries = body.get("entries")
    if isinstance(entries, list):
        table = any(isinstance(e, dict) and "cells" in e for e in entries)
        return f"{tag}Table" if table else f"{tag}DataSet"
    return tag


def _value(body: Node) -> Any:
    """Text or entries of an observation, as XML would have them."""
    key = next((k for k in _VALUES[::-1] if body.get(k) is not None), None)
    value = body[key] if key else ""
    if key == "entries" and isinstance(value, list):
        return [_net_entry(e) for e in value]
    if isinstance(value, dict):
        return [_entry(k, v) for k, v in value.items()]
    if isinstance(value, list):
        if any(isinstance(v, (dict, list)) for v in value):
            raise MalformedError("the observation's value is a list of more than numbers")
        return " ".join(word(v) for v in value)
    return word(value).strip(BLANK)


def _net_entry(entry: Any) -> Entry:
    if not isinstance(entry, dict):
        raise MalformedError("an entry of the data set is no JSON object")
    key = word(entry.get("key"))
    cells = entry.get("cells")
    if isinstance(cells, list) and all(isinstance(c, dict) for c in cells):
        return Entry(key, cells=tuple((word(c.get("key")), _text(c.get("value"))) for c in cells))
    return Entry(key, _text(entry.get("value")), removed=entry.get("removed") is True)


def _entry(key: str, value: Any) -> Entry:
    if isinstance(value, dict):
        if value.get("removed") in (True, "true"):
            return Entry(key, removed=True)
        if set(value) <= {"value", "removed", "key"}:
            return Entry(key, _text(value.get("value")))
        return Entry(key, cells=tuple((k, _text(v)) for k, v in value.items()))
    return Entry(key, _text(value))


def _text(value: Any) -> str:
    if isinstance(value, (dict, list)):
        raise MalformedError("an entry of the data set is no plain value")
    return word(value).strip(BLANK)
