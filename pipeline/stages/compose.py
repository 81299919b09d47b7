"""Stage: write params.yaml from conf/, with what ``dvc exp run -S`` sets on top."""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.parameters import NotYaml, as_section, as_yaml, read_params, read_yaml
from pipeline.schema.store import write_text

HEADER = "# Composed from conf/ by the stage compose; edit conf/, not this file.\n"
CATALOGUES = ("material", "tool")
CHOICES = ("budget", "cost", "optimisation", "promotion")
"""Groups whose section has their name, of which one file is chosen."""
BASELINE = "DVC_EXP_BASELINE_REV"
"""Variable with the commit that an experiment of DVC starts from."""

Keys = tuple[str, ...]
GONE = object()
"""The value of a key that is not there."""


def compose(conf: Path, params: Path) -> None:
    """Compose ``conf``, its catalogues and every machine of its fleet into ``params``.

    Under ``dvc exp run`` DVC has written each ``-S`` into the file already: where it differs from
    the file of the commit that the experiment starts from, the difference is put on top of a fresh
    composition, so that an edit of ``conf`` and ``-S`` both hold.

    Raises
    ------
    ValueError
        When ``conf`` does not compose, ``-S`` sets what cannot be set, or a section is not what its
        stage asks for; nothing is written then.
    """
    changes = _set_for_experiment(params)
    chosen = _chosen(changes, conf)
    text = composed(conf, chosen)
    values = read_yaml(text)
    groups = {keys[0] for keys in changes if _is_choice(keys, conf)}
    single = {keys: change for keys, change in changes.items() if keys[0] not in groups}
    if single:
        _refuse_edited(read_yaml(composed(conf)) if chosen else values, single)
        text = as_yaml(_changed(values, single))
    import_module("pipeline.stages.sections").check(values)  # its types change no byte of params
    if not params.exists() or params.read_text() != HEADER + text:
        write_text(HEADER + text, params)


Change = tuple[Any, Any]
"""Value at the commit that an experiment starts from, and the one that it sets."""


def _set_for_experiment(params: Path) -> dict[Keys, Change]:
    """What an experiment sets; nothing outside of one, or where the commit has no parameters."""
    commit = os.environ.get(BASELINE)
    if not commit or not params.exists():
        return {}
    answer = subprocess.run(
        ["git", "show", f"{commit}:./{params.name}"],
        cwd=params.resolve().parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if answer.returncode:
        return {}
    before, now = dict(_leaves(read_yaml(answer.stdout))), dict(_leaves(read_params(params)))
    return {
        keys: (before.get(keys, GONE), now.get(keys, GONE))
        for keys in (*now, *(keys for keys in before if keys not in now))
        if before.get(keys, GONE) != now.get(keys, GONE)
    }


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
    """Hydra's overrides for the groups that ``-S`` chooses.

    Raises
    ------
    ValueError
        When a group has no such entry, or is none that an experiment can choose.
    """
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
    """Ask back where ``conf``, composed without a choice, was edited at a key that is set.

    Raises
    ------
    ValueError
        When a key has one value in params.yaml, another in ``conf`` and a third in the commit.
    """
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
    """The composition, in place, with what an experiment sets."""
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
    """The composition of ``conf`` as YAML, at the budget of its fleet unless overrides choose one.

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
            if "chosen_budget" in fleet and not any(o.startswith("budget=") for o in overrides):
                overrides = (*overrides, f"budget={fleet.chosen_budget}")
            _check_machines(conf, list(fleet.machines))
            machines = [f"+machine@machine.{name}={name}" for name in fleet.machines]
            config = hydra_compose("config", overrides=[*overrides, *entries, *machines])
        return OmegaConf.to_yaml(config, resolve=True) + as_section(
            "catalogue", conf / "catalogue/default.yaml"
        )
    except (HydraException, OmegaConfBaseException, NotYaml) as error:
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
