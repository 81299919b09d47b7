"""Fleet on the command line: records, state, report."""

import glob
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from shutil import copy2
from typing import TYPE_CHECKING, Any

import yaml

from pipeline.app.output import LOG, check_folder
from pipeline.fleet import Fleet
from pipeline.parameters import HASHES, SETTINGS, ParametersError, read_params, read_yaml, structure
from pipeline.schema.files import content_key, keep, kept, replacing
from pipeline.schema.identity import MachineIdentity

if TYPE_CHECKING:
    from pipeline.signals.formats import RecordSource

CONF = Path("conf")
DATA = Path("data")
LOCK, LOCKS = Path("dvc.lock"), DATA / "locks"
"""The active fleet's lock, and the folder with those of the others: DVC writes the whole file anew
after each stage."""
PACKAGE = Path(__file__).parents[1]
COMPOSED_BY = (PACKAGE / "stages/compose.py", PACKAGE / "parameters.py")
"""Code that a composition is made by."""


@dataclass(frozen=True, kw_only=True)
class FileResult:
    """Result of one file; ``reason`` when none of it could be read, ``note`` for the rest."""

    path: Path
    read: int
    kept: int
    rejected: int
    reason: str | None
    note: str | None = None


def machine_parameters(machine: str) -> dict[str, Any]:
    """A machine's sections, whether or not it is in the fleet that is built."""
    check_machine(machine)
    return _composed(f"fleet.machines=['{machine}']")


def check_machine(machine: str) -> None:
    """Refuse a machine without a file, with those that are called like it."""
    names = sorted(p.stem for p in (CONF / "machine").glob("*.yaml"))
    if machine in names:  # which no path is
        return
    near = get_close_matches(machine, names)
    meant = f"; did you mean {' or '.join(near)}?" if near else "."
    raise ValueError(
        f"conf/machine/{machine}.yaml does not exist; known machines: {', '.join(names) or 'none'}"
        f"{meant} Run kerf in the project's folder, or write that file"
    )


def active_fleet() -> Fleet:
    """The fleet that `dvc repro` builds, also where params.yaml is still of the one before."""
    values, active = read_params(), CONF / "fleet/active.yaml"
    composed = structure(values, "fleet", dict)
    chosen = read_yaml(active.read_text(), str(active)) if active.exists() else composed
    changed = chosen.get("name") != composed.get("name")
    return structure({"fleet": chosen} if changed else values, "fleet", Fleet)


def outside_fleet(machine: str) -> str:
    """Reason why nothing is built of a machine that the active fleet lacks; empty otherwise."""
    try:
        fleet = active_fleet()
    except ParametersError:  # nothing was composed
        return ""
    if machine in fleet.machines:
        return ""
    files = sorted((CONF / "fleet").glob("*.yaml"))
    fleets = {f.stem: yaml.safe_load(f.read_text()) or {} for f in files}
    others = [name for name, one in fleets.items() if machine in (one.get("machines") or ())]
    name = others[0] if others else "NAME"
    return (
        f"{machine} is not in the fleet {fleet.name}, which is built here: run `kerf fleet {name}` "
        "and `dvc repro`"
    )


def _composed(override: str) -> dict[str, Any]:
    """Composition of ``conf/``, cached by all its sources: Hydra takes a second."""
    files = sorted(path for path in CONF.rglob("*.yaml") if path.is_file())
    versions = [version(name) for name in ("hydra-core", "omegaconf")]
    key = content_key([*COMPOSED_BY, *files], *versions, override)
    digest, _, text = (kept("conf", key) or b"").partition(b"\n")
    try:
        if digest != _digest(text):  # none, or a broken one
            from pipeline.stages.compose import composed

            text = composed(CONF, (override,)).encode()
            keep("conf", key, _digest(text) + b"\n" + text)
        values: dict[str, Any] = yaml.load(text, Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        raise ValueError(f"{CONF} does not compose: {' '.join(str(error).split())}") from error
    return values


def _digest(text: bytes) -> bytes:
    return sha256(text).hexdigest().encode()


def ingest_files(
    files: Sequence[Path], machine: str, out: Path, advance: Callable[[str], None]
) -> list[FileResult]:
    """Read ``files`` as records of ``machine`` into ``out``, which then holds nothing else."""
    from pipeline.signals.formats import RecordSource, source_of
    from pipeline.signals.ingest import ingest
    from pipeline.signals.store import early_ends

    for path in files:
        if not path.is_file():
            state = "is no file" if path.exists() else "does not exist"
            raise ValueError(f"{path} {state}: name the records to read, each one")
    check_folder(out)
    if out.resolve().is_relative_to((DATA / "signals").resolve()):
        raise ValueError(f"{out} is written by `dvc repro`: name another folder with --out")
    values = machine_parameters(machine)
    sources = structure(values, f"machine.{machine}.records", tuple[RecordSource, ...])
    identity = structure(values, f"machine.{machine}.identity", MachineIdentity)
    places = _places(files)
    with tempfile.TemporaryDirectory() as scratch:
        raw = Path(scratch)
        chosen: dict[str, RecordSource] = {}
        for place, path in places.items():
            (raw / place).parent.mkdir(exist_ok=True)
            (raw / place).symlink_to(path.resolve())
            source = source_of(path, sources)
            if source is not None:
                chosen[place] = replace(source, files=glob.escape(place))
        notes = _bring_devices(chosen, places, DATA / "raw" / machine, raw)
        ingest(raw, out, list(chosen.values()), identity, progress=advance)
    entries = json.loads((out / "manifest.json").read_text())["files"]
    notes |= early_ends(out) | _commonest_reasons(entries, out)
    return [
        FileResult(path=path, note=notes.get(place), **{
            name: entries[place][name] for name in ("read", "kept", "rejected", "reason")
        })
        for place, path in places.items()
    ]  # fmt: skip


def _places(files: Sequence[Path]) -> dict[str, Path]:
    """A name for each file, its own where no two are called the same."""
    from pipeline.signals.ingest import display_name

    names = [display_name(path.name).lstrip(".") or "records" for path in files]
    if len(set(names)) < len(names):
        width = len(str(len(names)))
        names = [f"{number:0{width}d}/{name}" for number, name in enumerate(names, 1)]
    return dict(zip(names, files, strict=True))


def _commonest_reasons(entries: dict[str, Any], out: Path) -> dict[str, str]:
    """Commonest reason of rejected records by place, for files of which none was kept."""
    from pipeline.signals.store import read_rejections

    found = {}
    for place, rejected in read_rejections(out).items():
        entry = entries[place]
        if not entry["kept"] and not entry["reason"] and rejected:
            reason, n = Counter(one.reason for one in rejected).most_common(1)[0]
            found[place] = f"nothing of it was kept: {reason} ({n} of {len(rejected)} rejected)"
    return found


def _bring_devices(
    chosen: dict[str, "RecordSource"], places: dict[str, Path], known: Path, raw: Path
) -> dict[str, str]:
    """Put the Devices documents from ``known``, or from beside the file, beside the records."""
    from pipeline.signals.store import sha256_of

    notes = {}
    for place, source in chosen.items():
        if source.devices is None:
            continue
        beside = places[place].resolve().parent
        folders = (known, beside, beside.parent)
        read = {path.resolve() for path in places.values()}  # records, whatever they are called
        named = [f / source.devices for f in folders]
        there = [one for one in named if one.is_file() and one.resolve() not in read]
        document = there[0] if there else None
        if document is None:
            chosen[place] = replace(source, devices=None)
            notes[place] = (
                f"{known / source.devices} does not exist, nor does it stand beside the file: "
                "kinds and units are not known"
            )
            continue
        hidden = f".devices/{sha256_of(document)[:12]}/{source.devices}"
        (raw / hidden).parent.mkdir(parents=True, exist_ok=True)
        if not (raw / hidden).exists():
            (raw / hidden).symlink_to(document.resolve())
        chosen[place] = replace(source, devices=hidden)
    return notes


def fleet_named(name: str) -> Fleet:
    """The fleet in ``conf/fleet/<name>.yaml``."""
    folder = CONF / "fleet"
    known = sorted(p.stem for p in folder.glob("*.yaml") if p.stem != "active")
    if name not in known:
        there = ", ".join(known) or "none"
        raise ValueError(f"{folder}/{name}.yaml does not exist; known fleets: {there}")
    try:
        written = yaml.safe_load((folder / f"{name}.yaml").read_text())
        chosen = structure({"fleet": written}, "fleet", Fleet)
    except (yaml.YAMLError, ValueError) as error:
        said = " ".join(str(error).split()).removeprefix("params.yaml, ")
        raise ValueError(f"{folder}/{name}.yaml is no fleet: {said}") from error
    _composed(f"fleet={name}")  # refuses machines that are not known
    return chosen


def use_fleet(name: str) -> Fleet:
    """Make ``conf/fleet/<name>.yaml`` the active one, with the lock of its last build."""
    chosen, folder = fleet_named(name), CONF / "fleet"
    empty = ("truth", "programs", "parts", "trials", "history")  # where no machine has any
    for some in empty:
        (DATA / some).mkdir(parents=True, exist_ok=True)
    # a plain file: in other revisions DVC would read a link's target by its name
    active, text = folder / "active.yaml", _whole(folder / f"{name}.yaml")
    before = ""
    with suppress(OSError, ParametersError):  # one that cannot be read
        before = str(read_yaml(active.read_text()).get("name") or "")
    if active.is_symlink() or not active.exists() or active.read_text() != text:
        with replacing(active, follow=False) as part:
            part.write_text(text)
    if before != chosen.name:
        old, new = (LOCKS / f"{Path(one).name}.lock" for one in (before or "unknown", chosen.name))
        for source, target in ((LOCK, old), (new, LOCK)):
            if source.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                source.replace(target)
    return chosen


def _whole(path: Path) -> str:
    """Text of a fleet's file, with the lists that it leaves out, as dvc.yaml names each of them."""
    from pipeline.submodels.contract import submodels

    written = yaml.safe_load(path.read_text())
    lists = {one: () for one in submodels()} | dict(written.get("submodels") or {})
    empty: dict[str, Any] = {"simulated": [], "drives_under": {}, "optimised": [], "trials": []}
    whole = {**empty, **written, "submodels": {one: list(some) for one, some in lists.items()}}
    if whole == written:
        return path.read_text()
    return f"# {path.name}, with what it leaves out.\n{yaml.safe_dump(whole, sort_keys=False)}"


def collect(fleet: Fleet, recordings: Path) -> Iterator[tuple[str, int, int]]:
    """Copy recordings to data/raw/<machine>; yield machine, new files, files in all."""
    from pipeline.signals.formats import RecordSource
    from pipeline.signals.store import sha256_of

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
        sources = structure(values, f"machine.{machine}.records", tuple[RecordSource, ...])
        wanted = _wanted(source, sources)
        new = 0
        for path in wanted:
            target = DATA / "raw" / machine / path.relative_to(source)
            if not (target.exists() and sha256_of(target) == sha256_of(path)):
                with replacing(target) as part:
                    copy2(path, part)
                target.chmod(0o644)
                new += 1
        yield machine, new, len(wanted)


def _wanted(folder: Path, sources: Sequence["RecordSource"]) -> list[Path]:
    found = {p for s in sources for p in folder.glob(s.files) if p.is_file()}
    if not found:
        names = ", ".join(s.files for s in sources)
        raise ValueError(f"{folder} holds no file that the machine's sources name ({names})")
    devices = {folder / s.devices for s in sources if s.devices}
    for path in devices:
        if not path.is_file():
            raise ValueError(f"{path} does not exist: put the agent's Devices document there")
    return sorted(found | devices)


def fleet_status() -> list[dict[str, str]]:
    """Rows of every machine of the fleet: its sub-models, their verdicts, what serves."""
    from pipeline.champions.promotion import settle
    from pipeline.champions.serving import status
    from pipeline.registry.store import offline

    fleet = active_fleet()
    if said := offline():
        LOG.warning("%s: the files of this project are shown", said)
    for name in () if said else fleet.machines:
        settle(name)
    return [row for name in fleet.machines for row in status(name, fleet.submodels_of(name))]


def write_report(out: Path) -> Path:
    """Write the pages from what stands in data/; the path of the first."""
    check_folder(out)
    from pipeline.report.texts import ReportSettings
    from pipeline.stages.report import report

    values, pages = read_params(), CONF / "pages/default.yaml"
    composed = structure(values, "pages", dict)
    if pages.exists() and (own := read_yaml(pages.read_text(), str(pages))) != composed:
        LOG.warning(
            "%s has %s and params.yaml %s, which the pages follow: run `dvc repro compose` first",
            pages, own, composed,
        )  # fmt: skip
    report(
        signals=DATA / "signals", clean=DATA / "clean", models=DATA / "models",
        champion=DATA / "champion", golden=DATA / "golden", truth=DATA / "truth",
        programs=DATA / "programs", parts=DATA / "parts", trials=DATA / "trials",
        history=DATA / "history", ledger=DATA / "ledger", twin_state=DATA / "twin_state",
        condition=DATA / "condition", incidents=DATA / "incidents",
        settings=SETTINGS / HASHES, reports=out, metrics=out / "metrics.json",
        fleet=structure(values, "fleet", Fleet),
        budget=structure(values, "budget", str), pages=structure(values, "pages", ReportSettings),
    )  # fmt: skip
    return out / "index.html"
