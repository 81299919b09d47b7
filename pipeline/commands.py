"""What stands behind the command ``kerf``: each a thing that a person asks for once."""

import glob
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from shutil import copy2
from typing import Any

import cattrs

from pipeline.fleet import Fleet
from pipeline.parameters import read_params, structure
from pipeline.signals.ingest import MachineIdentity, ingest
from pipeline.signals.records import RecordSource
from pipeline.signals.sniff import sniff
from pipeline.validation.golden import GoldenWeek, Week, freeze, write_golden

CONF = Path("conf")
DATA = Path("data")


@dataclass(frozen=True, kw_only=True)
class FileResult:
    """What became of one file; ``reason`` when none of it could be read."""

    path: Path
    read: int
    kept: int
    rejected: int
    reason: str | None


@contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A bar on standard error when a person looks, nothing in a log."""
    if not sys.stderr.isatty():
        yield lambda name: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)

        def advance(name: str) -> None:
            bar.update(task, advance=1, description=f"{what} {name}")

        yield advance


def machine_parameters(machine: str) -> dict[str, Any]:
    """A machine's sections, whether or not it is in the fleet that is built.

    Raises
    ------
    ValueError
        When conf/machine/ has no such machine.
    """
    if not (CONF / "machine" / f"{machine}.yaml").exists():
        known = ", ".join(sorted(p.stem for p in (CONF / "machine").glob("*.yaml"))) or "none"
        raise ValueError(
            f"conf/machine/{machine}.yaml does not exist; known machines: {known}. "
            "Run kerf in the project's folder, or write that file"
        )
    import yaml

    from pipeline.stages.compose import composed

    values: dict[str, Any] = yaml.safe_load(composed(CONF, (f"fleet.machines=[{machine}]",)))
    return values


def ingest_files(
    files: Sequence[Path], machine: str, out: Path, advance: Callable[[str], None]
) -> list[FileResult]:
    """Read ``files`` as records of ``machine`` into ``out``.

    A file is read as the machine's file in ``conf/machine/`` says for files of such a name, else as
    what its first bytes say.

    Raises
    ------
    ValueError
        When a file does not exist or the machine is not known.
    """
    absent = [p for p in files if not p.is_file()]
    if absent:
        raise ValueError(f"{absent[0]} is no file: name the records to read")
    values = machine_parameters(machine)
    sources = structure(values, f"machine.{machine}.records", tuple[RecordSource, ...])
    identity = structure(values, f"machine.{machine}.identity", MachineIdentity)
    with tempfile.TemporaryDirectory() as scratch:
        raw = Path(scratch)
        chosen = []
        for number, path in enumerate(files):
            place = f"{number:0{len(str(len(files)))}d}/{path.name}" if len(files) > 1 else path.name
            (raw / place).parent.mkdir(exist_ok=True)
            (raw / place).symlink_to(path.resolve())
            chosen.append(replace(source_of(path, sources), files=glob.escape(place)))
        for devices in {s.devices for s in chosen if s.devices}:
            known = DATA / "raw" / machine / devices
            if known.exists():
                (raw / devices).parent.mkdir(parents=True, exist_ok=True)
                (raw / devices).symlink_to(known.resolve())
        given = [s if (raw / (s.devices or ".")).exists() else replace(s, devices=None) for s in chosen]
        ingest(raw, out, given, identity, progress=advance)
    entries = json.loads((out / "manifest.json").read_text())["files"]
    return [
        FileResult(
            path=path,
            **{key: entries[glob_name(source.files)][key] for key in ("read", "kept", "rejected", "reason")},
        )
        for path, source in zip(files, chosen, strict=True)
    ]


def glob_name(pattern: str) -> str:
    """The file name behind a pattern that :func:`glob.escape` made."""
    return pattern.replace("[*]", "*").replace("[?]", "?").replace("[[]", "[")


def source_of(path: Path, sources: Sequence[RecordSource]) -> RecordSource:
    """How to read ``path``: as a source of the machine that fits its format and name."""
    form = sniff(path)
    alike = [s for s in sources if s.format == form]
    named = [s for s in alike if fnmatch(path.name, s.files.rpartition("/")[2])]
    return (named or alike or [RecordSource(format=form, files=path.name)])[0]


def use_fleet(name: str) -> Fleet:
    """Make ``conf/fleet/<name>.yaml`` the active one.

    Raises
    ------
    ValueError
        When there is no such fleet.
    """
    folder = CONF / "fleet"
    if name == "active" or not (folder / f"{name}.yaml").exists():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.yaml") if p.stem != "active"))
        raise ValueError(f"{folder}/{name}.yaml does not exist; known fleets: {known or 'none'}")
    import yaml

    chosen = cattrs.Converter(forbid_extra_keys=True).structure(
        yaml.safe_load((folder / f"{name}.yaml").read_text()), Fleet
    )
    (DATA / "truth").mkdir(parents=True, exist_ok=True)  # empty where nothing is simulated
    link = folder / "active.yaml"
    if not (link.is_symlink() and os.readlink(link) == f"{name}.yaml"):
        link.unlink(missing_ok=True)
        link.symlink_to(f"{name}.yaml")
    return chosen


def collect(fleet: Fleet, recordings: Path) -> Iterator[tuple[str, int, int]]:
    """Copy each machine's recordings to data/raw/<machine>; yield machine, files new, files in all.

    Raises
    ------
    ValueError
        When a folder is missing.
    """
    for machine in fleet.machines:
        values = machine_parameters(machine)
        identity = structure(values, f"machine.{machine}.identity", MachineIdentity)
        if not identity.recordings:
            continue
        source = recordings / identity.recordings
        if not source.is_dir():
            raise ValueError(
                f"{source} does not exist: name the folder that holds {identity.recordings} "
                "with --recordings (make: RECORDINGS=…)"
            )
        records = structure(values, f"machine.{machine}.records", tuple[RecordSource, ...])
        wanted = {p for s in records for p in source.glob(s.files) if p.is_file()}
        wanted |= {source / s.devices for s in records if s.devices}
        new = 0
        for path in sorted(wanted):
            target = DATA / "raw" / machine / path.relative_to(source)
            if not target.exists() or target.read_bytes() != path.read_bytes():
                target.parent.mkdir(parents=True, exist_ok=True)
                copy2(path, target)
                target.chmod(0o644)
                new += 1
        yield machine, new, len(wanted)


def freeze_golden(machine: str, first: str, last: str) -> GoldenWeek:
    """Freeze the files of ``machine`` from ``first`` to ``last``, both included.

    Raises
    ------
    ValueError
        When a day is no date, the machine's records were not ingested, or none is in the week.
    """
    from datetime import date

    days = [date.fromisoformat(day).isoformat() for day in (first, last)]
    manifest = DATA / "signals" / machine / "manifest.json"
    if not manifest.exists():
        raise ValueError(f"{manifest} does not exist: run `dvc repro ingest@{machine}` first")
    frozen = freeze(
        machine, Week(first=days[0], last=days[1]), json.loads(manifest.read_text())["files"]
    )
    write_golden(frozen, DATA / "golden" / f"{machine}.json")
    return frozen


def fleet_status() -> list[dict[str, str]]:
    """One row a machine: origin, golden-week verdict, registered versions by alias."""
    from pipeline.registry import versions

    values = read_params()
    fleet = structure(values, "fleet", Fleet)
    rows = []
    for machine in fleet.machines:
        identity = structure(values, f"machine.{machine}.identity", MachineIdentity)
        judged = DATA / "models" / machine / "validation.json"
        document = json.loads(judged.read_text()) if judged.exists() else None
        scores = (document or {}).get("windows", {}).get("all")
        known = {alias: v for v in versions(machine) for alias in v.aliases}
        rows.append(
            {
                "machine": machine,
                "origin": identity.origin,
                "golden week": document["verdict"] if document else "not judged: run `dvc repro`",
                "error over 1 h [K]": f"{scores['model']['mae_K']:.2f}" if scores else "-",
                **{
                    alias: f"version {known[alias].version}, {known[alias].verdict}"
                    if alias in known
                    else "-"
                    for alias in ("champion", "challenger", "previous")
                },
            }
        )
    return rows


def write_report(out: Path) -> Path:
    """Write the pages from what stands in data/; the path of the first."""
    from pipeline.stages.report import report

    values = read_params()
    folders = [DATA / name for name in ("signals", "clean", "models", "golden", "truth")]
    report(
        *folders,
        out,
        fleet=structure(values, "fleet", Fleet),
        budget=structure(values, "budget", str),
        machine=structure(values, "machine", dict[str, Any]),
    )
    return out / "index.html"
