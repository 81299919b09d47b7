"""Provenance of a bundle: hashes, settings, key figures, requirements."""

import hashlib
import importlib.metadata
import json
import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.charts.sources import hash_of_files
from pipeline.schema.bundle import MODEL, VERDICT, Bundle
from pipeline.schema.imports import Module, libraries, modules
from pipeline.schema.model import Model
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict

CHAMPIONS = Path("champions.json")
LOCK = Path("requirements.lock")
PACKAGE = Path(__file__).parents[1]


def requirements(submodels: Iterable[str], root: Path = Path()) -> list[str]:
    """Distributions that sub-models import, pinned by requirements.lock, else as installed."""
    entries = [f"{PACKAGE.name}.submodels.{name}.submodel" for name in submodels]
    own, whose = _known()
    needed = {whose[one][0].lower() for one in libraries(own, entries)}
    lock = root / LOCK
    lines = lock.read_text().splitlines() if lock.exists() else []
    pinned = dict(line.split("==", 1) for line in lines if re.match(r"[\w.-]+==", line))
    return [
        f"{name}=={pinned.get(name) or importlib.metadata.version(name)}" for name in sorted(needed)
    ]


@cache
def _known() -> tuple[dict[str, Module], Mapping[str, list[str]]]:
    """Modules of this process's code, and the distributions of importable names."""
    return modules(PACKAGE), importlib.metadata.packages_distributions()


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values as ``a.b.c`` keys, of characters that MLflow takes."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = prefix + plain(key)
        found |= flat(value, f"{name}.") if isinstance(value, Mapping) else {name: value}
    return found


def plain(key: Any) -> str:
    """A key of the characters that MLflow takes."""
    return re.sub(r"[^\w.: -]", "_", str(key))


def model_of_bundle(name: str, folder: Path) -> Model:
    """Model of a sub-model in ``folder``."""
    from pipeline.submodels.contract import submodel

    return read_json(folder / MODEL, submodel(name).model)


def key_figures(name: str, folder: Path) -> dict[str, float]:
    """Key figures of the verdict on a sub-model in ``folder``, and its parameters, as numbers."""
    from pipeline.submodels.judge import metrics

    found = flat(metrics(read_json(folder / VERDICT, Verdict)), f"{name}.")
    for group, parameters in model_of_bundle(name, folder).parameters.items():
        prefix = f"{name}.parameter.{group}." if group else f"{name}.parameter."
        found |= flat({key: one.value for key, one in parameters.items()}, prefix)
    return {name: float(v) for name, v in found.items() if isinstance(v, int | float)}


def training_files(name: str, folder: Path) -> list[tuple[str, str]]:
    """Raw files that a sub-model in ``folder`` was fitted on, with the sha256 of each."""
    files = model_of_bundle(name, folder).training_files
    return sorted((file, sha256) for sha256, file in files.items())


def parameters_of(name: str, folder: Path) -> dict[str, str]:
    """Identified parameters with unit and 95 % interval, as words; a key of 250 at most."""
    found = {}
    for group, parameters in model_of_bundle(name, folder).parameters.items():
        for key, one in parameters.items():
            unit = "" if one.unit in ("", "1") else f" {one.unit}"
            low, high = one.interval_95 or (None, None)
            interval = "" if low is None or high is None else f" ({low:.4g} to {high:.4g})"
            known = one.determined and one.value is not None
            said = f"{one.value:.6g}{interval}{unit}" if known else "not determined"
            found[plain(f"{group}.{key}" if group else key)[:250]] = said
    return found


def provenance(
    bundle: Bundle, folder: Path, root: Path, made_with: Mapping[str, Any]
) -> dict[str, str]:
    """Tags that say what a version was made of; the bundle's own hash is the last."""
    raw: set[tuple[str, str]] = set()
    golden: set[str] = set()
    tags: dict[str, str] = {}
    for name, one in bundle.submodels.items():
        verdict = read_json(folder / name / VERDICT, Verdict)
        raw |= set(training_files(name, folder / name))
        golden |= {verdict.golden.sha256} if verdict.golden else set()
        tags |= {f"{name}.sha256": one.sha256, f"{name}.status": one.status}
    return tags | {
        "machine": bundle.machine,
        "origin": bundle.origin,
        "status": bundle.status,
        "raw_sha256": hash_of_files(raw),
        "golden_sha256": " ".join(sorted(golden)),
        "made_with_sha256": hashlib.sha256(
            json.dumps(made_with, sort_keys=True, default=str).encode()
        ).hexdigest(),
        "params_sha256": _file_hash(root / "params.yaml"),
        "dvc_lock_sha256": _file_hash(root / "dvc.lock"),
        "git_commit": git("rev-parse", "HEAD", root=root) or "",
        "dirty": dirty(root),
        "bundle_sha256": bundle.sha256,
    }


def _file_hash(path: Path) -> str:
    """Hash of a file's bytes, ``""`` when there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""


def git(*words: str, root: Path = Path()) -> str | None:
    """Output of git; None outside a repository or without git."""
    if shutil.which("git") is None:
        return None
    answer = subprocess.run(
        ["git", "-C", str(root), *words], capture_output=True, text=True, check=False
    )
    return answer.stdout.strip() if answer.returncode == 0 else None


def dirty(root: Path) -> str:
    """Whether the tree, outputs aside, differs from the commit: ``"true"``, ``"false"``, ``""``."""
    written = [f":(exclude){name}" for name in
               ("data", "reports", "params.yaml", "dvc.lock", CHAMPIONS.name)]  # fmt: skip
    said = git("status", "--porcelain", "--", ".", *written, root=root)
    return "" if said is None else str(bool(said)).lower()
