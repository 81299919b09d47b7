"""Project outside of Kerf's own folder: conf/, dvc.yaml and DVC, run by the installed Kerf."""

import hashlib
import shutil
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path

from pipeline.parameters import SETTINGS
from pipeline.registry.provenance import CHAMPIONS
from pipeline.schema.bundle import Champions
from pipeline.schema.store import write_json, write_text
from pipeline.stages.compose import compose

CODE = "kerf-version"
"""File of the version and hash of the code: what the stage ``code`` depends on in place of it."""
SHARE = "share/kerf-twin"
HELD = ("code.json", "golden/", "history/", "index/", "locks/", "metrics/", "settings/")
"""Parts of data/ that git holds."""
IGNORED = (
    "mlflow.db",
    "mlartifacts/",
    "/data/*",
    *(f"!/data/{name}" for name in HELD),
    "/reports",
)


def new_project(folder: Path) -> str:
    """Make a project in ``folder``, or bring its dvc.yaml to the installed Kerf."""
    there = folder.exists() and any(folder.iterdir()) if not folder.is_file() else True
    known = (folder / CODE).is_file()
    if there and not known:
        raise ValueError(f"{folder} is no empty folder and no project of Kerf: name another one")
    source = templates()
    if not known:
        shutil.copytree(source / "conf", folder / "conf")
        first = (source / "conf/fleet/demo.yaml").read_text(encoding="utf-8")
        write_text(first, folder / "conf/fleet/active.yaml")
        write_text("\n".join(IGNORED) + "\n", folder / ".gitignore")
        write_json(Champions(), folder / CHAMPIONS)
        _set_up_dvc(folder)
        # `kerf status` reads them
        compose(folder / "conf", folder / "params.yaml", folder / SETTINGS)
    for some in ("golden", "history"):  # stages depend on them
        (folder / "data" / some).mkdir(parents=True, exist_ok=True)
        (folder / "data" / some / ".gitkeep").touch()
    _bring_groups(source / "conf", folder / "conf")
    ignored = (folder / ".gitignore").read_text().splitlines()
    if missing := [line for line in IGNORED if line.startswith("!") and line not in ignored]:
        write_text("\n".join([*ignored, *missing]) + "\n", folder / ".gitignore")
    write_text(_of_project((source / "dvc.yaml").read_text(encoding="utf-8")), folder / "dvc.yaml")
    write_text(f"{version('kerf-twin')} {_code_hash()}\n", folder / CODE)
    return "brought up" if known else "made"


def _bring_groups(source: Path, conf: Path) -> None:
    """Bring groups of settings that a later Kerf has to a project, with their entries."""
    config = (conf / "config.yaml").read_text(encoding="utf-8")
    for line in (source / "config.yaml").read_text(encoding="utf-8").splitlines():
        group = line.strip().removeprefix("- ").partition(":")[0]
        if not (source / group / "default.yaml").is_file() or (conf / group).exists():
            continue
        shutil.copytree(source / group, conf / group)
        config = config.replace("  - budget:", f"{line}\n  - budget:", 1)
    write_text(config, conf / "config.yaml")


def templates() -> Path:
    """Folder with conf/ and dvc.yaml: Kerf's own checkout, else what was installed with it."""
    checkout = Path(__file__).parents[2]
    if (checkout / "dvc.yaml").is_file() and (checkout / "conf").is_dir():
        return checkout
    try:
        files = distribution("kerf-twin").files or []
    except PackageNotFoundError:
        files = []
    for file in files:
        if file.as_posix().endswith(f"{SHARE}/dvc.yaml"):
            return Path(str(file.locate())).resolve().parent
    raise ValueError("Kerf was installed without its templates: install the distribution kerf-twin")


def _of_project(text: str) -> str:
    """dvc.yaml whose stage ``code`` looks at the installed Kerf, not at a checkout."""
    return text.replace("      - pipeline\n", f"      - {CODE}\n")


def _code_hash() -> str:
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _set_up_dvc(folder: Path) -> None:
    """Make the folder a repository of DVC, inside of the git repository that holds it, if any."""
    git = shutil.which("git")
    inside = (
        git
        and not subprocess.run(
            [git, "-C", str(folder), "rev-parse"], capture_output=True, check=False
        ).returncode
    )
    how = [] if (folder / ".git").exists() else ["--subdir"] if inside else ["--no-scm"]
    answer = subprocess.run(
        [sys.executable, "-m", "dvc", "init", "-q", *how],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if answer.returncode:
        raise ValueError(f"DVC cannot be set up in {folder}: {' '.join(answer.stderr.split())}")
