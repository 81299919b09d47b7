"""Machine files in conf/machine/ proposed from Devices document, logs and tables, and written."""

import glob
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copy2

from pipeline.app.fleet import CONF, DATA
from pipeline.app.machine_signals import Choice, SignalMapping, find_signals, table_lines
from pipeline.app.records import (
    ItemSeries,
    item_series,
)
from pipeline.schema.days import UTC, check_zone, days_of
from pipeline.schema.files import replacing
from pipeline.schema.identity import MachineIdentity
from pipeline.signals.formats import RecordSource, UnreadableFile, format_of
from pipeline.signals.ingest import OBSERVING, ingest
from pipeline.signals.mtconnect.devices import DeviceModel, chosen, read_devices

SPINDLE = ("spindle_speed", "spindle_load", "spindle_temperature")
"""Signals without which the spindle's temperature cannot be modelled."""
LEARNT = 2 / 3
"""Share of the days that is proposed to be learnt from [1]."""


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """Proposed content of a new machine's file."""

    name: str
    """Name of the machine."""
    model: DeviceModel
    """Model of the one device that the records describe."""
    devices: str | None
    device: str | None
    """Devices document below the machine's folder, and the device's name in it."""
    groups: tuple[tuple[str, str], ...]
    """Format and pattern of its logs."""
    series: dict[str, ItemSeries]
    """Reports of the logs, by data item."""
    mapping: SignalMapping
    """Data items of the signals."""
    time_zone: str = UTC
    """Time zone of the plant's days."""
    tables: tuple[str, ...] = ()
    """Lines of the records of its tables, as YAML."""

    @property
    def days(self) -> list[str]:
        """Days of the plant on which the spindle's temperature, else anything, was reported."""
        item = self.mapping.signals.get("spindle_temperature", "")
        some = [self.series[item]] if item in self.series else list(self.series.values())
        days = {d for one in some for d in days_of(one.time[one.known], self.time_zone)}
        return sorted(days)

    @property
    def learnt(self) -> list[str]:
        """The first days, to be learnt from; the others are left to judge by."""
        days = self.days
        return days[: max(1, round(LEARNT * len(days)))]

    @property
    def lacking(self) -> list[str]:
        """Signals that the spindle's model needs and no item is."""
        return [name for name in SPINDLE if name not in self.mapping.signals]

    @property
    def strangers(self) -> list[str]:
        """Items with values in the logs that the device does not describe."""
        spoken = (name for name, one in self.series.items() if one.known.any())
        return [name for name in spoken if self.model.find(name) is None]


def propose(
    name: str,
    devices: Path | None,
    logs: Sequence[Path],
    device: str | None,
    raw: Path,
    time_zone: str = UTC,
) -> Proposal:
    """Proposed content of the machine's file; ``devices`` and ``logs`` are copied into ``raw``."""
    check_zone(time_zone)
    documents = [devices] if devices else []
    for path in (*documents, *logs):
        if not path.is_file():
            raise ValueError(f"{path} is no file: name the Devices document and each log")
    if not documents and not any(path.stat().st_size for path in logs):
        raise ValueError(
            f"{logs[0]} is empty: give the Devices document, logs or tables with records"
            if logs else "nothing is named: give the Devices document, logs or tables"
        )  # fmt: skip
    try:
        every = read_devices(devices, device) if devices else DeviceModel(items=())
    except UnreadableFile as error:
        raise ValueError(f"{devices}: {error}") from error
    documents, records = _into(raw, documents), _into(raw, logs)
    groups, tables = _groups(raw, records)
    if len(every.devices) > 1:
        names = set(_read(raw, groups, name, None, None))
        device = _meant(every, names)
        every = chosen(every, device)
    place = documents[0].relative_to(raw).as_posix() if documents else None
    series = _read(raw, groups, name, place, device)
    items = [(every.item_name(i), i) for i in every.items]
    return Proposal(
        name=name, model=every, devices=place, device=device, groups=groups, series=series,
        mapping=find_signals(items, series), time_zone=time_zone, tables=tables,
    )  # fmt: skip


def _into(raw: Path, files: Sequence[Path]) -> list[Path]:
    """The files in ``raw``, copied there where they stand elsewhere; equal names are refused."""
    placed = []
    for path in files:
        if path.resolve().is_relative_to(raw.resolve()):
            placed.append(raw / path.resolve().relative_to(raw.resolve()))
            continue
        target = raw / path.name
        if target.exists() and target.read_bytes() != path.read_bytes():
            raise ValueError(f"{target} is there already and is not {path}: name it otherwise")
        raw.mkdir(parents=True, exist_ok=True)
        copy2(path, target)
        target.chmod(0o644)
        placed.append(target)
    return placed


def _groups(
    raw: Path, records: Sequence[Path]
) -> tuple[tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Format and pattern of the logs, and lines for the tables: for each folder, ending, format."""
    found: list[tuple[str, str]] = []
    tables: dict[tuple[str, str], list[str]] = {}
    for path in records:
        form = format_of(path)
        below = path.relative_to(raw)
        folder = "".join(f"{glob.escape(part)}/" for part in below.parent.parts)
        group = (form, f"{folder}*{glob.escape(path.suffix)}")
        if form in OBSERVING:
            found.append(group)
        elif group not in tables:
            tables[group] = table_lines(path, *group)
    return tuple(dict.fromkeys(found)), tuple(line for some in tables.values() for line in some)


def _read(
    raw: Path, groups: Sequence[tuple[str, str]], name: str, devices: str | None, device: str | None
) -> dict[str, ItemSeries]:
    sources = [RecordSource(format=form, files=files, devices=devices, device=device)  # type: ignore[arg-type]
               for form, files in groups]  # fmt: skip
    if not sources:
        return {}
    with tempfile.TemporaryDirectory() as scratch:
        ingest(raw, Path(scratch), sources, MachineIdentity(name=name))
        return item_series(Path(scratch))


def _meant(every: DeviceModel, names: set[str]) -> str:
    """The one device that describes most of the items in the logs; never an agent's own."""
    machines = [one for one in every.devices if not one.is_agent] or list(every.devices)
    if len(machines) == 1:
        return machines[0].label
    shares = {}
    for one in machines:
        known = chosen(every, one.label)
        shares[one.label] = sum(bool(known.called(n)) for n in names)
    order = sorted(shares, key=lambda label: -shares[label])
    if not names or shares[order[0]] == shares[order[1]]:
        there = ", ".join(f"{n} ({shares[n]} of {len(names)} items)" if names else n for n in order)
        raise ValueError(f"the Devices document has {there}: say which one with --device")
    return order[0]


def machine_text(p: Proposal) -> str:
    """The proposed file as YAML, every signal with its reason."""
    lines = [
        f"# Proposed by `kerf machine new {p.name}` from "
        + " and ".join(["the Devices document"] * bool(p.devices) + ["the logs"] * bool(p.series)
                       + ["the tables"] * bool(p.tables)) + "; check it and correct it.",
        "identity:",
        f"  name: {p.name}",
        f"  description: {_quoted(p.device or p.name)}   # make and kind, for people",
        "  origin: recorded",
        *_roles(p),
        *_records(p),
        *_spindle(p),
        "mapping:",
        "  signals:" if p.mapping.choices else "  signals: {}",
    ]  # fmt: skip
    for choice in p.mapping.choices.values():
        lines += _signal(choice)
    lines.append(f"  time_zone: {p.time_zone}   # days go from midnight to midnight of this clock")
    if p.mapping.position_control:
        inside = ", ".join(f"{k}: {_quoted(v)}" for k, v in p.mapping.position_control.items())
        lines.append(f"  position_control: {{{inside}}}   # the spindle stands while C moves")
    elif "c_angle" in p.mapping.signals and "spindle_speed" in p.mapping.signals:
        inside = (
            f"angle: {p.mapping.signals['c_angle']}, speed: {p.mapping.signals['spindle_speed']}"
        )
        lines.append("  # If the modelled spindle is the C axis too, also set")
        lines.append("  # spindle.position_control to true above, and:")
        lines.append(f"  # position_control: {{{inside}}}")
    return "\n".join(lines) + "\n"


def _quoted(word: str) -> str:
    return word if word.replace("_", "").isalnum() and word[0].isalpha() else f'"{word}"'


def _roles(p: Proposal) -> list[str]:
    if not p.days:
        return ["# roles: {training_days: {first: YYYY-MM-DD, last: YYYY-MM-DD}}   # to learn from"]
    learnt = p.learnt
    return [
        "roles:                           # days that models learn from; all others judge them",
        f'  training_days: {{first: "{learnt[0]}", last: "{learnt[-1]}"}}',
    ]


def _records(p: Proposal) -> list[str]:
    there = p.groups or p.tables
    lines = ["records:"] if there else ["records:   # which files there are; none was named"]
    for form, files in p.groups if there else (("shdr", "*.txt"),):
        lines += [f"  - format: {form}", f'    files: "{files}"']
        lines += [f"    devices: {p.devices}"] if p.devices else []
        lines += [f"    device: {_quoted(p.device)}"] if p.device else []
        if form == "shdr":
            lines.append("    values: units   # or native, if an adapter wrote the log")
    return [*lines, *p.tables]


def _spindle(p: Proposal) -> list[str]:
    said = p.mapping.signals
    extra = [n for n in ("second_spindle_speed", "second_spindle_load", "path_feedrate")
             if n in said]  # fmt: skip
    return [
        "spindle:",
        f"  position_control: {str(bool(p.mapping.position_control)).lower()}",
        f"  ambient: {str('ambient_temperature' in said).lower()}",
        f"  extra: [{', '.join(extra)}]",
    ]


def _signal(choice: Choice) -> list[str]:
    if choice.item is not None:
        return [f"    {choice.signal}: {_quoted(choice.item)}   # {choice.why}"]
    some = " or ".join(choice.candidates)
    return [f"    # {choice.signal}: {some}   ({choice.why})"]


def fleet_text(p: Proposal, submodels: Sequence[str]) -> str:
    """A fleet of this machine alone, as YAML."""
    able = [] if p.lacking or not p.days else ["spindle"]
    lines = [f"# The machine {p.name} alone; add other machines to its lists.", f"name: {p.name}",
             f"machines: [{p.name}]", "simulated: []", "submodels:"]  # fmt: skip
    lines += [f"  {one}: [{p.name if one in able else ''}]" for one in submodels]
    return "\n".join([*lines, "drives_under: {}", "optimised: []", "trials: []"]) + "\n"


def said(p: Proposal, submodels: Sequence[tuple[str, str, str]]) -> list[str]:
    """Findings in lines; ``submodels`` are name, title and what to record for each."""
    lines = []
    if p.devices or p.groups:
        lines.append(f"{len(p.model.items)} data items of {p.device or 'the device'} are "
                     f"described, {len(p.series)} stand in the logs")  # fmt: skip
    if p.tables:
        lines.append("columns of tables stand in comments, with what each could be: choose")
    for choice in p.mapping.choices.values():
        where = choice.item or "open: " + " or ".join(choice.candidates)
        lines.append(f"  {choice.signal}: {where} ({choice.why})")
    if p.strangers and p.series:
        some = ", ".join(p.strangers[:5]) + (" …" if len(p.strangers) > 5 else "")
        lines.append(f"{len(p.strangers)} items with values are not in the Devices document "
                     f"({some}): is a log of another machine among them?")  # fmt: skip
    for name, title, needs in submodels:
        if name == "spindle" and not p.lacking and not p.days:
            lines.append(f"{title}: no day of records is here; put logs into data/raw/{p.name}, "
                         f"name days in roles of conf/machine/{p.name}.yaml, and {p.name} under "
                         f"spindle in conf/fleet/{p.name}.yaml")  # fmt: skip
        elif name == "spindle" and not p.lacking:
            lines.append(f"{title}: the records allow it")
        elif name == "spindle":
            lines.append(f"{title}: no item is {', '.join(p.lacking)}; record {needs}")
        else:
            lines.append(f"{title}: record {needs}")
    return lines


def next_steps(p: Proposal) -> list[str]:
    """The commands that follow, in order."""
    left = [day for day in p.days if day not in p.learnt]
    lines = [f"kerf fleet {p.name}", "dvc repro"]
    if left:
        days = f"--first {left[0]} --last {left[-1]}"
        lines += [f"kerf golden --machine {p.name} {days}", "dvc repro"]
    return lines


def write_machine(
    name: str, devices: Path | None, logs: Sequence[Path], device: str | None, time_zone: str = UTC
) -> list[str]:
    """Write ``conf/machine/<name>.yaml``, its fleet and ``conf/schema/``; report in lines."""
    from pipeline.app.json_schema import PLACE, first_line, write_schemas
    from pipeline.submodels.contract import submodel, submodels

    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise ValueError(f"{name!r} is no name of a machine: letters, digits and _, a letter first")
    targets = [CONF / "machine" / f"{name}.yaml", CONF / "fleet" / f"{name}.yaml"]
    for path in targets:
        if path.exists():
            raise ValueError(f"{path} is there already: name another machine, or remove it")
    if not (CONF / "machine").is_dir():
        raise ValueError(f"{CONF / 'machine'} does not exist: run kerf in the project's folder")
    found = propose(
        name, devices, list(_files(logs, devices)), device, DATA / "raw" / name, time_zone
    )
    every = [submodel(one) for one in submodels()]
    texts = [
        first_line("machine") + machine_text(found),
        first_line("fleet") + fleet_text(found, [one.name for one in every]),
    ]
    for path, text in zip(targets, texts, strict=True):
        with replacing(path) as part:
            part.write_text(text)
    write_schemas(CONF / PLACE.name)
    return [
        *said(found, [(one.name, one.title, one.needs) for one in every]),
        f"wrote {targets[0]} and {targets[1]}: read them, correct them, then",
        *(f"  {line}" for line in next_steps(found)),
    ]


def _files(logs: Sequence[Path], devices: Path | None) -> Iterator[Path]:
    for path in logs:
        below = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        yield from (p for p in below if not devices or p.resolve() != devices.resolve())
