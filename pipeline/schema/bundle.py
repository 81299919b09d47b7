"""Bundle of a machine (all its sub-models by hash) and the champions that serve.

A bundle is identified by what predicts: ``model.json`` and the further files of each sub-model, and
the status of its verdict.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.schema.files import exchange
from pipeline.schema.store import StoreError, content, parsed, read_json, write_json
from pipeline.schema.verdict import Status, Verdict

if TYPE_CHECKING:
    import pandas as pd

MODEL, VERDICT, PREDICTIONS, SERVED, BUNDLE = (
    "model.json", "verdict.json", "predictions.parquet", "served.json", "bundle.json"
)  # fmt: skip
KINDS = {"M": "datetime", "f": "double", "i": "long", "u": "long", "b": "boolean"}
"""MLflow's name of a column's type by numpy's letter; any other is a string."""


@dataclass(frozen=True, kw_only=True)
class Served:
    """The content of ``served.json``: columns that a sub-model takes and answers, with types."""

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]


def served(example: "pd.DataFrame", predicted: "pd.DataFrame") -> Served:
    """Columns of a sub-model's own example and of what it predicts from it."""
    kinds = [
        {str(name): KINDS.get(getattr(kind, "kind", "O"), "string")
         for name, kind in frame.dtypes.items()}
        for frame in (example, predicted)
    ]  # fmt: skip
    return Served(inputs=kinds[0], outputs=kinds[1])


@dataclass(frozen=True, kw_only=True)
class BundledModel:
    """One sub-model of a bundle: hash over the files that predict, and its verdict's status."""

    sha256: str
    status: Status


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """The content of ``bundle.json``: a machine and its sub-models."""

    machine: str
    origin: str
    """Machine, and origin of its records."""
    submodels: Mapping[str, BundledModel]
    """Sub-models by name."""
    sha256: str
    """Hash of the whole: over the names, hashes and statuses of its sub-models."""

    @property
    def status(self) -> Status:
        """The gravest status of its sub-models; of failed ones ``failed`` before all others."""
        statuses = {one.status for one in self.submodels.values()}
        if "failed" in statuses:
            return "failed"
        if statuses == {"passed"}:
            return "passed"
        return "not decided" if statuses == {"passed", "not decided"} else "not judged"

    def named(self, *statuses: Status) -> str:
        """Sub-models with one of some statuses: ``"drive failed, cutting not judged"``."""
        return ", ".join(
            f"{name} {one.status}" for name, one in self.submodels.items() if one.status in statuses
        )


@dataclass(frozen=True, kw_only=True)
class Champion:
    """The bundle that serves a machine: since when, by whom and why."""

    version: int
    bundle: str
    since: str
    by: str
    why: str
    serving: tuple[str, ...] | None = None
    """Sub-models that serve; None where a choice of before says nothing of it, so that all do."""

    def serves(self, name: str) -> bool:
        """Whether a sub-model of the bundle serves."""
        return self.serving is None or name in self.serving


@dataclass(frozen=True, kw_only=True)
class Champions:
    """The content of ``champions.json``: what serves at present, as the histories say it."""

    machines: Mapping[str, Champion] = field(default_factory=dict)
    histories: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of the last entry of each machine's history."""

    def promoted(self, machine: str, champion: Champion, last: str = "") -> "Champions":
        """These champions with one machine's replaced, in the order of the machines' names."""
        lasts = self.histories if not last else {**self.histories, machine: last}
        return Champions(machines=dict(sorted({**self.machines, machine: champion}.items())),
                         histories=dict(sorted(lasts.items())))  # fmt: skip


def read_champions(path: Path) -> Champions:
    """The champions in ``champions.json``; none where there is no such file."""
    if not path.exists():
        return Champions()
    remedy = f"restore it with `git checkout {path.name}`"
    said = read_json(path, dict[str, Any], remedy)
    said.pop("looks", None)  # looks at sealed sets stand in the histories now
    return parsed(json.dumps(said).encode(), Champions, str(path), remedy)


def predicting_files(folder: Path) -> list[Path]:
    """Files of a sub-model's folder that predict, in the order of their names below it."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    judged = {folder / name for name in (VERDICT, PREDICTIONS, SERVED)}
    predicting = [path for path in files if path not in judged]
    return sorted(predicting, key=lambda path: path.relative_to(folder).as_posix())


def model_hash(folder: Path) -> str:
    """One sha256 over the names and bytes of a sub-model's files that predict."""
    digest = hashlib.sha256()
    for path in predicting_files(folder):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def bundle_of(folder: Path, machine: str, names: Iterable[str]) -> Bundle:
    """Bundle of a machine's sub-models in ``data/models`` or ``data/champion``, or StoreError."""
    submodels, origins = {}, set()
    digest = hashlib.sha256(machine.encode())
    for name in sorted(names):
        content(folder / name / MODEL)
        one, origin = _hashed(folder / name, machine, name, _stamps(folder / name))
        digest.update(f"\0{name}\0{one.sha256}\0{one.status}".encode())
        submodels[name] = one
        origins.add(origin)
    origin = " and ".join(sorted(origins))
    return Bundle(machine=machine, origin=origin, submodels=submodels, sha256=digest.hexdigest())


def _stamps(folder: Path) -> tuple[tuple[str, int, int, int, int], ...]:
    """Names of a folder's files with what changes when one is written."""
    return tuple(
        (path.as_posix(), known.st_ino, known.st_size, known.st_mtime_ns, known.st_ctime_ns)
        for path in sorted(folder.rglob("*")) if path.is_file() and (known := path.stat())
    )  # fmt: skip


@cache
def _hashed(folder: Path, machine: str, name: str, stamps: object) -> tuple[BundledModel, str]:
    """A sub-model of a bundle and its origin, once for the same ``stamps`` of its files."""
    path = folder / VERDICT
    try:
        verdict = _verdict(content(path))
    except StoreError:
        verdict = read_json(path, Verdict)  # says where
    if (verdict.machine, verdict.submodel) != (machine, name):
        raise StoreError(
            f"{path} is the verdict of {verdict.machine}'s {verdict.submodel}, not of {machine}'s "
            f"{name}: run `dvc repro`"
        )
    return BundledModel(sha256=model_hash(folder), status=verdict.status), verdict.origin


@cache
def _verdict(text: bytes) -> Verdict:
    """A verdict, once for the same bytes: of champion and challenger most are the same."""
    return parsed(text, Verdict, VERDICT)


def stored_bundle(folder: Path, machine: str) -> Bundle | None:
    """Bundle that a folder with ``bundle.json`` holds, by hashes taken anew; None if broken."""
    try:
        said = parsed(content(folder / BUNDLE), Bundle, str(folder / BUNDLE))
        return bundle_of(folder, machine, said.submodels)
    except StoreError:
        return None


def copy_bundle(source: Path, bundle: Bundle, target: Path, warm: Path | None = None) -> None:
    """Fill the folder ``target`` with a bundle at once: models, verdicts and ``bundle.json``.

    A run that breaks off leaves the bundle of before or this one; that of before goes to ``warm``.
    """
    beside = target.with_name(f".{target.name}.new")
    shutil.rmtree(beside, ignore_errors=True)
    for name in bundle.submodels:
        folder = source / name
        for path in (*predicting_files(folder), folder / VERDICT, folder / SERVED):
            copy = beside / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
    write_json(bundle, beside / BUNDLE)
    if not target.exists():
        beside.replace(target)
        return
    exchange(beside, target)
    if warm is not None and (beside / BUNDLE).exists():  # after the copy: it may be the source
        shutil.rmtree(warm, ignore_errors=True)
        warm.parent.mkdir(parents=True, exist_ok=True)
        beside.replace(warm)
    shutil.rmtree(beside, ignore_errors=True)


def bundle_words(models: Path) -> str:
    """Identity of the bundle in a folder, and the verdict of its drives, in words."""
    if not (models / BUNDLE).exists():
        return f"none, {models.as_posix()} holds no {BUNDLE}"
    bundle = read_json(models / BUNDLE, Bundle)
    drive = bundle.submodels.get("drive")
    judged = "" if drive is None else f" (drive {drive.status})"
    return f"bundle {bundle.sha256[:12]}{judged}"
