"""Stage: write params.yaml from conf/."""

import os
import re
from difflib import get_close_matches
from pathlib import Path

from pipeline.parameters import as_section
from pipeline.schema.store import write_text

HEADER = "# Composed from conf/ by the stage compose; edit conf/, not this file.\n"
CATALOGUES = ("material", "tool")


def compose(conf: Path, params: Path) -> None:
    """Compose ``conf``, its catalogues and every machine of its fleet into ``params``.

    Under ``dvc exp run -S`` the file was written by DVC already and is kept.
    """
    if os.environ.get("DVC_EXP_NAME") and params.exists():
        return
    text = HEADER + composed(conf)
    if not params.exists() or params.read_text() != text:
        write_text(text, params)


def composed(conf: Path, overrides: tuple[str, ...] = ()) -> str:
    """The composition of ``conf`` as YAML.

    Each file of ``conf/material/`` and ``conf/tool/`` is a section of its name, the cutting data of
    ``conf/catalogue/`` are one.

    Raises
    ------
    ValueError
        When a group, a machine's file or a value in ``conf`` does not fit; the message names it.
    """
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    entries = [entry for group in CATALOGUES for entry in _entries(conf, group)]
    try:
        with initialize_config_dir(str(conf.resolve()), version_base=None):
            fleet = hydra_compose("config", overrides=list(overrides)).fleet
            _check_machines(conf, list(fleet.machines))
            machines = [f"+machine@machine.{name}={name}" for name in fleet.machines]
            config = hydra_compose("config", overrides=[*overrides, *entries, *machines])
        return OmegaConf.to_yaml(config, resolve=True) + as_section(
            "catalogue", conf / "catalogue/default.yaml"
        )
    except (HydraException, OmegaConfBaseException) as error:
        raise ValueError(f"{conf} does not compose: {' '.join(str(error).split())}") from error


def _check_machines(conf: Path, names: list[str]) -> None:
    """Refuse a machine of the fleet that has no file, with the names that are like it."""
    known = sorted(path.stem for path in (conf / "machine").glob("*.yaml"))
    for name in names:
        if name not in known:
            near = get_close_matches(name, known)
            hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(known)}"
            raise ValueError(
                f"the fleet names the machine {name!r}, and {conf}/machine/{name}.yaml does not "
                f"exist: {hint}"
            )


def _entries(conf: Path, group: str) -> list[str]:
    """Overrides that put each file of a catalogue under its name."""
    names = sorted(path.stem for path in (conf / group).glob("*.yaml"))
    for name in names:
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name):
            raise ValueError(
                f"{conf}/{group}/{name}.yaml has no name for a section: use letters, digits, _ and "
                "-, a letter first"
            )
    return [f"+{group}@{group}.{name}={name}" for name in names]
