"""Stage: write params.yaml and data/settings from conf/, what ``dvc exp run -S`` sets on top."""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.parameters import (
    SETTINGS,
    NotYaml,
    as_section,
    as_yaml,
    joined,
    parted,
    read_yaml,
    settings_texts,
)
from pipeline.schema.store import write_text

HEADER = "# Composed from conf/ by the stage compose; edit conf/, not this file.\n"
ENTRIES = ("material", "tool")
"""Groups of which every file is an entry of the section of their name."""
CHOICES = ("budget", "cost", "incidents", "monitoring", "optimisation", "promotion")
"""Groups whose section has their name, of which one file is chosen."""
BASELINE = "DVC_EXP_BASELINE_REV"
"""Variable with the commit that an experiment of DVC starts from."""

Keys = tuple[str, ...]
GONE = object()
"""The value of a key that is not there."""


def compose(conf: Path, params: Path, settings: Path) -> None:
    """Compose ``conf``, its catalogues and every machine of its fleet.

    Under ``dvc exp run`` a file differs from its commit by each ``-S``: the difference is put on
    top of a fresh composition, so that an edit of ``conf`` and ``-S`` both hold.
    """
    changes = _set_for_experiment(params, settings)
    chosen = _chosen(changes, conf)
    values = read_yaml(composed(conf, chosen))
    groups = {keys[0] for keys in changes if _is_choice(keys, conf)}
    single = {keys: change for keys, change in changes.items() if keys[0] not in groups}
    if single:
        _refuse_edited(read_yaml(composed(conf)) if chosen else values, single)
        values = _changed(values, single)
    import_module("pipeline.stages.sections").check(values)  # its types change no byte of params
    write_settings(values, params, settings)


def write_settings(values: dict[str, Any], params: Path, settings: Path) -> None:
    """Write a composition to ``params`` and the folder ``settings``, what differs from it alone."""
    own, parts = parted(values)
    texts = {params: HEADER + as_yaml(own)} | {settings / n: text for n, text in parts.items()}
    for path in set(settings.rglob("*.json")) - set(texts):
        path.unlink()
    for path, text in texts.items():
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(text, path)


Change = tuple[Any, Any]
"""Value at the commit that an experiment starts from, and the one that it sets."""


def _set_for_experiment(params: Path, settings: Path) -> dict[Keys, Change]:
    """Changes by an experiment; none outside of one, or without parameters in the commit."""
    commit = os.environ.get(BASELINE)
    if not commit or not params.exists():
        return {}
    root = params.resolve().parent
    text = _of_commit(commit, params.name, root)
    if text is None:
        return {}
    texts = settings_texts(settings)
    beside = {name: _of_commit(commit, f"{SETTINGS}/{name}", root) for name in texts}
    files = {name: one for name, one in beside.items() if one is not None}
    before = dict(_leaves(joined(read_yaml(text), files)))
    own = {name: texts[name] for name in files}  # of machines that the commit has
    now = dict(_leaves(joined(read_yaml(params.read_text()), own)))
    return {
        keys: (before.get(keys, GONE), now.get(keys, GONE))
        for keys in (*now, *(keys for keys in before if keys not in now))
        if before.get(keys, GONE) != now.get(keys, GONE)
    }


def _of_commit(commit: str, name: str, root: Path) -> str | None:
    """Text of a file in a commit; None where the commit does not have it."""
    answer = subprocess.run(
        ["git", "show", f"{commit}:./{name}"], cwd=root, capture_output=True, text=True, check=False
    )
    return None if answer.returncode else answer.stdout


def _leaves(values: Mapping[str, Any], above: Keys = ()) -> Iterator[tuple[Keys, Any]]:
    """Values with the keys that lead to them; a list, and a mapping without keys, is one value."""
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def _is_choice(keys: Keys, conf: Path) -> bool:
    """Whether keys name a group of ``conf`` itself, such as ``budget`` or ``fleet``."""
    return keys[0] == "fleet" or (len(keys) == 1 and (conf / keys[0]).is_dir())


def _chosen(changes: Mapping[Keys, Change], conf: Path) -> tuple[str, ...]:
    """Hydra's overrides for the groups that ``-S`` chooses."""
    found = []
    for keys, (_, name) in changes.items():
        if not _is_choice(keys, conf):
            continue
        group = keys[0]
        if group == "fleet":
            raise ValueError(
                f"-S {'.'.join(keys)} cannot be set for an experiment, since dvc.yaml takes its "
                "lists of machines from conf/fleet/active.yaml: run `kerf fleet NAME` first, "
                "then `dvc exp run`"
            )
        known = sorted(path.stem for path in (conf / group).glob("*.yaml"))
        if group not in CHOICES:
            raise ValueError(f"-S {group} is no choice: set one of its values, {group}.KEY=VALUE")
        if name not in known:
            raise ValueError(
                f"-S {group}={name} names no file of conf/{group}: choose one of {', '.join(known)}"
            )
        found.append(f"{group}={name}")
    return tuple(found)


def _refuse_edited(values: dict[str, Any], changes: Mapping[Keys, Change]) -> None:
    """Ask back where ``conf``, composed without a choice, was edited at a key that is set."""
    own = dict(_leaves(values))
    for keys, (before, now) in changes.items():
        there = own.get(keys, GONE)
        if there not in (now, before):
            raise ValueError(
                f"{'.'.join(keys)} is {_said(now)} in params.yaml, {_said(there)} in conf/ and "
                f"{_said(before)} in the commit: undo the edit in conf/, or run "
                "`dvc repro compose` and leave -S out"
            )


def _changed(values: dict[str, Any], changes: Mapping[Keys, Change]) -> dict[str, Any]:
    for keys, (_, now) in changes.items():
        place = values
        for key in keys[:-1]:
            if not isinstance(place.get(key), dict):
                place[key] = {}
            place = place[key]
        if now is GONE:
            place.pop(keys[-1], None)
        else:
            place[keys[-1]] = now
    return values


def _said(value: Any) -> str:
    return "not there" if value is GONE else repr(value)


def composed(conf: Path, overrides: tuple[str, ...] = ()) -> str:
    """Composition of ``conf`` as YAML, at the budget of its fleet unless overrides choose one."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    entries = [entry for group in ENTRIES for entry in _entries(conf, group)]
    try:
        with initialize_config_dir(str(conf.resolve()), version_base=None):
            fleet = hydra_compose("config", overrides=list(overrides)).fleet
            _check_machines(conf, list(fleet.machines))
            if not any(one.startswith("budget=") for one in overrides):
                overrides = (*overrides, f"budget={fleet.get('chosen_budget', 'default')}")
            machines = [f"+machine@machine.{name}={name}" for name in fleet.machines]
            config = hydra_compose("config", overrides=[*overrides, *entries, *machines])
        return OmegaConf.to_yaml(config, resolve=True) + as_section(
            "catalogue", conf / "catalogue/default.yaml"
        )
    except (HydraException, OmegaConfBaseException, NotYaml) as error:
        raise ValueError(f"{conf} does not compose: {' '.join(str(error).split())}") from error


def _check_machines(conf: Path, names: list[str]) -> None:
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
