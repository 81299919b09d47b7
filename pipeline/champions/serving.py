"""What serves: the champion of each machine, its files, and what the registry holds of it."""

import fcntl
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from pipeline.registry.history import server_history
from pipeline.registry.loading import checked_place
from pipeline.registry.provenance import CHAMPIONS
from pipeline.registry.runs import MadeWith, register, renumber
from pipeline.registry.sqlite import ARTIFACTS, Version
from pipeline.registry.store import DATABASE, is_shared, name_versions, offline, versions
from pipeline.schema.bundle import (
    BUNDLE,
    VERDICT,
    Bundle,
    Champion,
    bundle_of,
    copy_bundle,
    read_champions,
    stored_bundle,
)
from pipeline.schema.decision import PromotionSettings
from pipeline.schema.history import Entry, champion_in, read_history, served
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.verdict import Verdict

LOG = logging.getLogger("pipeline.champions")
DATA = Path("data")
NO_SUBMODEL = "none in this fleet: its page says what to record"
EXPERIMENT_RUN = "DVC_EXP_BASELINE_REV"
"""Variable that DVC sets for the stages of `dvc exp run`."""
FIRST_BY, FIRST_WHY = "dvc repro", "first bundle"


def history_of(machine: str, root: Path = Path()) -> tuple[Entry, ...]:
    """The machine's history, whole by itself, its decisions and champions.json.

    Raises StoreError where it is not, see :func:`~pipeline.schema.history.read_history`.
    """
    return read_history(history_path(machine, root), elsewhere=is_shared())


def history_path(machine: str, root: Path = Path()) -> Path:
    """File of the machine's history."""
    return root / DATA / "history" / f"{machine}.jsonl"


def champion_of(machine: str, root: Path = Path()) -> Champion | None:
    """Champion: the one that was chosen, else the first in ``data/champion``."""
    chosen = chosen_champion(machine, root)
    held = stored_bundle(root / DATA / "champion" / machine, machine)
    return chosen if chosen is not None or held is None else first_champion(held, root)


def chosen_champion(machine: str, root: Path = Path()) -> Champion | None:
    """Champion by the history, else by champions.json; None where nobody has chosen one.

    Raises StoreError as :func:`history_of` does.
    """
    serving = served(history_of(machine, root))
    if serving:
        return champion_in(serving[-1])
    return read_champions(root / CHAMPIONS).machines.get(machine)


def first_champion(bundle: Bundle, root: Path = Path()) -> Champion:
    """Champion without a promotion; version 0 where no store that answers has it."""
    known = [] if offline() else versions(bundle.machine, root)
    number = next((v.version for v in known if v.bundle == bundle.sha256), 0)
    lacking = bundle.named("failed", "not decided", "not judged")
    return Champion(
        version=number, bundle=bundle.sha256, since="", by=FIRST_BY,
        why=f"{FIRST_WHY}: {lacking}" if lacking else FIRST_WHY, serving=serving_of(bundle),
    )  # fmt: skip


def serving_of(bundle: Bundle) -> tuple[str, ...]:
    """Sub-models of a bundle that serve unless somebody says otherwise: those that passed."""
    return tuple(name for name, one in bundle.submodels.items() if one.status == "passed")


def first_serving(newest: Bundle, registered: Sequence[Version]) -> str:
    """Hash of the bundle that serves where none does: one that passed, else the newest."""
    passed = [v.bundle for v in registered if v.status == "passed"]
    return newest.sha256 if newest.status == "passed" or not passed else passed[-1]


def numbers_of(machine: str, root: Path = Path()) -> dict[int, str]:
    """Bundles that the history, or champions.json, names by their versions: each for ever."""
    chosen = read_champions(root / CHAMPIONS).machines.get(machine)
    named = [(e.version, e.bundle)
             for e in (*server_history(machine, root), *history_of(machine, root))]  # fmt: skip
    named += [(chosen.version, chosen.bundle)] if chosen else []
    return {number: bundle for number, bundle in reversed(named) if number}


def version_numbers(machine: str, root: Path = Path()) -> dict[str, int]:
    """Number of each bundle by its hash: the history's, else the registry's."""
    stored = {v.bundle: v.version for v in reversed(versions(machine, root))}
    return stored | {bundle: number for number, bundle in numbers_of(machine, root).items()}


def numbered(machine: str, number: int, root: Path) -> Version:
    """Registered version of a number, see :func:`version_numbers`.

    Raises ValueError when there is none.
    """
    numbers = version_numbers(machine, root)
    known = {numbers[v.bundle]: v for v in versions(machine, root)}
    if number not in known:
        there = ", ".join(map(str, sorted(known))) or "none"
        raise ValueError(f"{machine} has no version {number}; there are {there}")
    return known[number]


def keep_serving(machine: str, names: Sequence[str], root: Path = Path()) -> Champion:
    """Register missing bundles of a machine, and fill ``data/champion`` with the one that serves.

    It is the promoted bundle, else the one that serves already, else the newest.  Raises StoreError
    when a model is missing or broken; ValueError when the bundle of champions.json lies nowhere.
    """
    with locked(machine, root):
        return _kept(machine, names, root)


def _kept(machine: str, names: Sequence[str], root: Path) -> Champion:
    newest = bundle_of(root / DATA / "models" / machine, machine, names)
    champion = champion_of(machine, root)
    experiment = bool(os.environ.get(EXPERIMENT_RUN))  # what it makes challenges nobody
    _register_all(machine, names, root, champion, None if experiment else newest)
    wanted = champion.bundle if champion else first_serving(newest, versions(machine, root))
    filled = fill_champion(machine, wanted, names, root)
    champion = champion_of(machine, root) or first_champion(filled, root)
    shared = served(server_history(machine, root))
    unheard = shared and shared[-1].bundle != wanted  # by this clone
    if experiment or unheard:
        return champion
    other = None if wanted == newest.sha256 else newest.sha256
    name_versions(machine, root, champion, challenger=other)
    return champion


def _register_all(
    machine: str, names: Sequence[str], root: Path, champion: Champion | None, newest: Bundle | None
) -> None:
    """Register what the history names, in the order of its numbers, and then the newest bundle."""
    numbers, before = numbers_of(machine, root), versions(machine, root)
    for one in before:
        if numbers.get(one.version, one.bundle) != one.bundle:
            LOG.warning(
                "version %d of %s in the registry is version %d now: in its history %d is another "
                "bundle", one.version, machine, renumber(one, root, numbers), one.version,
            )  # fmt: skip
    own = {bundle: number for number, bundle in numbers.items()}
    gone = {e.bundle for e in history_of(machine, root) if e.event == "deleted"}
    found: list[tuple[Bundle, Path, MadeWith]] = []
    for name in ("warm", "champion"):
        folder = root / DATA / name / machine
        there = stored_bundle(folder, machine)
        known = own if name == "warm" else {champion.bundle} if champion else ()
        if there is not None and there.sha256 in known and there.sha256 not in gone:
            found.append((there, folder, dict))
    if newest is not None:
        found.append((newest, root / DATA / "models" / machine,
                      partial(made_with, machine, names, root)))  # fmt: skip
    for bundle, folder, settings in sorted(found, key=lambda one: own.get(one[0].sha256, inf)):
        register(bundle, folder, root, made_with=settings, numbers=numbers)
    if numbers and not before:
        again = ", ".join(str(one.version) for one in versions(machine, root))
        LOG.warning(
            "the registry had no version of %s: it holds %s now, by the numbers of its history, "
            "and counts on after %d",
            machine, again, max(numbers),
        )  # fmt: skip


def refilled(machine: str, names: Sequence[str], root: Path) -> Champion | None:
    """The champion; a store that lacks it, or counts otherwise than its history, is filled first.

    Raises ValueError as :func:`keep_serving` does.
    """
    champion, numbers = champion_of(machine, root), numbers_of(machine, root)
    known = versions(machine, root)
    right = all(numbers.get(v.version, v.bundle) == v.bundle for v in known)
    if champion is None or newest_bundle(machine, names, root) is None or (
        right and champion.bundle in {v.bundle for v in known}
    ):  # fmt: skip
        return champion
    return keep_serving(machine, names, root)


@contextmanager
def locked(what: str, root: Path) -> Iterator[None]:
    """Hold a machine, or ``champions``, the file of all, against others who change it."""
    (root / DATA).mkdir(parents=True, exist_ok=True)
    with (root / DATA / f".{what}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def fill_champion(
    machine: str, bundle: str, names: Sequence[str], root: Path, *, keep: bool = False
) -> Bundle:
    """Fill ``data/champion/<machine>`` with the bundle of a hash; see :func:`bundle_place`.

    With ``keep`` what it held stays warm.  Raises ValueError when the bundle lies nowhere.
    """
    source, held = bundle_place(machine, bundle, names, root)
    target, warm = (root / DATA / name / machine for name in ("champion", "warm"))
    if source != target:
        copy_bundle(source, held, target, warm if keep else None)
    return held


def bundle_place(
    machine: str, bundle: str, names: Sequence[str], root: Path
) -> tuple[Path, Bundle]:
    """Folder with the bundle of a hash: what serves, is warm, is newest, or is registered.

    Raises ValueError when it lies nowhere.
    """
    models, target = (root / DATA / name / machine for name in ("models", "champion"))
    for folder in (target, root / DATA / "warm" / machine):
        there = stored_bundle(folder, machine)
        if there is not None and there.sha256 == bundle:
            return folder, there
    newest = newest_bundle(machine, names, root)
    if newest is not None and newest.sha256 == bundle:
        return models, newest
    found = [v for v in versions(machine, root) if v.bundle == bundle]
    if not found:
        raise ValueError(
            f"bundle {bundle[:12]}, which serves {machine} by champions.json or is to serve, is "
            f"neither in {models}, nor in {target}, nor in the registry: run `dvc pull {target}`, "
            f"or bring {DATABASE} and {ARTIFACTS} along, or take {machine} out of champions.json "
            f"and run `dvc repro`, so that what is in {target}, else the newest bundle, serves"
        )
    source = checked_place(found[0], root) / "artifacts" / "bundle"
    return source, read_json(source / BUNDLE, Bundle)


def newest_bundle(machine: str, names: Sequence[str], root: Path) -> Bundle | None:
    """The bundle in ``data/models/<machine>``; None without one, and while it is half built."""
    try:
        return bundle_of(root / DATA / "models" / machine, machine, names) if names else None
    except StoreError:
        return None


def params_of(root: Path) -> dict[str, Any]:
    """All sections of params.yaml."""
    from pipeline.parameters import PARAMS, read_params

    return read_params(root / PARAMS)


def promotion_settings(root: Path) -> PromotionSettings:
    """Tolerances in params.yaml, or the usual ones."""
    from pipeline.parameters import structure

    values = params_of(root)
    return structure(values | {"promotion": values.get("promotion", {})}, "promotion",
                     PromotionSettings)  # fmt: skip


def names_of(machine: str, root: Path) -> tuple[str, ...]:
    """Sub-models of a machine in the fleet that is built."""
    from pipeline.fleet import Fleet
    from pipeline.parameters import structure

    return structure(params_of(root), "fleet", Fleet).submodels_of(machine)


def made_with(machine: str, names: Sequence[str], root: Path) -> dict[str, Any]:
    """Sections of params.yaml that the sub-models of a machine were made with, by sub-model."""
    from pipeline.parameters import section_path
    from pipeline.submodels.contract import sections, submodel

    values = params_of(root)
    found: dict[str, Any] = {}
    for name in names:
        one = submodel(name)
        for section in sections(one.fitting) | sections(one.judging):
            part: Any = values
            for key in section_path(values, section, machine).split("."):
                part = part[key]
            found[section] = part
    return found


def status(machine: str, names: Sequence[str], root: Path = Path()) -> list[dict[str, str]]:
    """Rows for ``kerf status``: one for each of the sub-models of a machine.

    Columns: ``machine``, ``origin``, ``sub-model``, ``latest`` and ``champion`` (verdicts),
    ``serving`` and ``challenger`` (versions; a number that only a server knows is ``-`` while it
    does not answer).  A missing champion is filled into the store first.
    """
    if not names:
        keys = ("origin", "sub-model", "latest", "champion", "serving", "challenger")
        return [{"machine": machine, **dict.fromkeys(keys, "-"), "latest": NO_SUBMODEL}]
    away, models = bool(offline()), root / DATA / "models" / machine
    champion = champion_of(machine, root) if away else refilled(machine, names, root)
    numbers = {} if away else version_numbers(machine, root)
    serves = stored_bundle(root / DATA / "champion" / machine, machine)
    newest = newest_bundle(machine, names, root)
    serving = challenger = "-"
    if champion is not None:
        since = f" since {champion.since[:10]}" if champion.since else ""
        serving = f"version {champion.version or '-'}{since}"
        if newest is not None and newest.sha256 != champion.bundle:
            challenger = f"version {numbers.get(newest.sha256, '-')}"
    rows = []
    for name in names:
        path = models / name / VERDICT
        verdict = read_json(path, Verdict) if path.exists() else None
        held = serves.submodels.get(name) if serves else None
        idle = "" if champion is None or champion.serves(name) else ", does not serve"
        rows.append(
            {
                "machine": machine, "origin": verdict.origin if verdict else "-",
                "sub-model": name,
                "latest": verdict.status if verdict else "not built: run `dvc repro`",
                "champion": f"{held.status}{idle}" if held and champion else "-",
                "serving": serving, "challenger": challenger,
            }
        )  # fmt: skip
    return rows
