"""Write a proposed machine into conf/, and read the records of one that is there."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.app.fleet import CONF, DATA, machine_parameters
from pipeline.app.machine import fleet_text, machine_text, next_steps, propose, said
from pipeline.app.records import ItemRecord, described_units, machine_records
from pipeline.parameters import structure
from pipeline.schema.days import UTC
from pipeline.schema.files import replacing
from pipeline.signals.cleaning.settings import CleanMachine


def write_machine(
    name: str, devices: Path | None, logs: Sequence[Path], device: str | None, time_zone: str = UTC
) -> list[str]:
    """Propose ``conf/machine/<name>.yaml`` and a fleet of it; what was found, in lines.

    The schemas by which an editor checks them are written into ``conf/schema/``.
    """
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
    """The logs that are named, and every file of a folder that is."""
    for path in logs:
        below = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        yield from (p for p in below if not devices or p.resolve() != devices.resolve())


def records_of(machine: str) -> list[ItemRecord]:
    """Rows of every item in the machine's ingested records."""
    values = machine_parameters(machine)
    signals = DATA / "signals" / machine
    if not (signals / "manifest.json").exists():
        raise ValueError(f"{signals} holds no records: run `dvc repro ingest@{machine}` first")
    mapping = structure(values, f"machine.{machine}.mapping", CleanMachine)
    return machine_records(signals, mapping.signal_of, described_units(signals))
