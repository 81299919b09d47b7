"""Champions: the bundle of each machine that serves, and its replacement by another.

``champions.json`` names the promoted ones; git holds it, so that a promotion is a commit.
``data/champion`` holds the files of all; the aliases in the registry follow.
"""

import getpass
import os
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.registry.loading import checked_place
from pipeline.registry.provenance import CHAMPIONS, git
from pipeline.registry.runs import register
from pipeline.registry.store import (
    ARTIFACTS,
    DATABASE,
    Version,
    name_versions,
    note_promotion,
    versions,
)
from pipeline.schema.bundle import (
    BUNDLE,
    VERDICT,
    Bundle,
    Champion,
    Champions,
    SealedLook,
    bundle_of,
    copy_bundle,
    read_champions,
    stored_bundle,
    write_champions,
)
from pipeline.schema.golden import GoldenSets, read_golden
from pipeline.schema.store import StoreError, read_json
from pipeline.schema.verdict import Role, Verdict

if TYPE_CHECKING:
    from pipeline.submodels.promotion import Contest

DATA = Path("data")
NO_SUBMODEL = "none in this fleet: its page says what to record"
FIRST_BY, FIRST_WHY = "dvc repro", "first bundle"


def champion_of(machine: str, root: Path = Path()) -> Champion | None:
    """Champion: the promoted bundle, else the first one in ``data/champion``."""
    chosen = read_champions(root / CHAMPIONS).machines.get(machine)
    held = stored_bundle(root / DATA / "champion" / machine, machine)
    return chosen if chosen is not None or held is None else first_champion(held, root)


def first_champion(bundle: Bundle, root: Path = Path()) -> Champion:
    """Champion without a promotion; version 0 where no store has it."""
    known = versions(bundle.machine, root)
    number = next((v.version for v in known if v.bundle == bundle.sha256), 0)
    lacking = bundle.named("failed", "not decided", "not judged")
    why = f"{FIRST_WHY}: {lacking}" if lacking else FIRST_WHY
    return Champion(version=number, bundle=bundle.sha256, since="", by=FIRST_BY, why=why)


def first_serving(newest: Bundle, registered: Sequence[Version]) -> str:
    """Hash of the bundle that serves where none does: one that passed, else the newest."""
    passed = [v.bundle for v in registered if v.status == "passed"]
    return newest.sha256 if newest.status == "passed" or not passed else passed[-1]


def keep_serving(machine: str, names: Sequence[str], root: Path = Path()) -> Champion:
    """Register missing bundles of a machine, and fill ``data/champion`` with the one that serves.

    It is the promoted bundle, else the one that serves already, else the newest.  Raises StoreError
    when a model is missing or broken; ValueError when the bundle of champions.json lies nowhere.
    """
    models, serves = root / DATA / "models" / machine, root / DATA / "champion" / machine
    newest, champion = bundle_of(models, machine, names), champion_of(machine, root)
    held = stored_bundle(serves, machine)
    if champion is not None and held is not None and held.sha256 == champion.bundle:
        register(held, serves, root)
    register(newest, models, root, made_with=lambda: made_with(machine, names, root))
    wanted = champion.bundle if champion else first_serving(newest, versions(machine, root))
    filled = fill_champion(wanted, names, models, serves, root=root)
    champion = read_champions(root / CHAMPIONS).machines.get(machine) or first_champion(
        filled, root
    )
    other = None if wanted == newest.sha256 else newest.sha256
    name_versions(machine, root, champion=wanted, challenger=other)
    note_promotion(machine, root, champion)
    return champion


def _refilled(machine: str, names: Sequence[str], root: Path) -> Champion | None:
    """The champion; a store that lacks it, deleted or another server, is filled first."""
    champion, models = champion_of(machine, root), root / DATA / "models" / machine
    known = {v.bundle for v in versions(machine, root)}
    if champion is None or champion.bundle in known or newest_bundle(models, names) is None:
        return champion
    return keep_serving(machine, names, root)


def fill_champion(
    bundle: str, names: Sequence[str], models: Path, target: Path, *, root: Path = Path()
) -> Bundle:
    """Fill ``target`` with the bundle of a hash, from ``models``, itself or the registry.

    Raises ValueError when it lies nowhere.
    """
    machine = target.name
    newest = newest_bundle(models, names)
    if newest is not None and newest.sha256 == bundle:
        copy_bundle(models, newest, target)
        return newest
    there = stored_bundle(target, machine)
    if there is not None and there.sha256 == bundle:
        return there
    found = [v for v in versions(machine, root) if v.bundle == bundle]
    if not found:
        raise ValueError(
            f"champions.json names bundle {bundle[:12]} as the champion of {machine}, which is "
            f"neither in {models}, nor in {target}, nor in the registry: run `dvc pull {target}`, "
            f"or bring {DATABASE} and {ARTIFACTS} along, or take {machine} out of champions.json "
            f"and run `dvc repro`, so that what is in {target}, else the newest bundle, serves"
        )
    source = checked_place(found[0], root) / "artifacts" / "bundle"
    held = read_json(source / BUNDLE, Bundle)
    copy_bundle(source, held, target)
    return held


def newest_bundle(models: Path, names: Sequence[str]) -> Bundle | None:
    """The bundle in ``data/models/<machine>``; None without one, and while it is half built."""
    try:
        return bundle_of(models, models.name, names) if names else None
    except StoreError:
        return None


def promote(
    machine: str,
    root: Path = Path(),
    *,
    why: str,
    by: str = "",
    anyway: bool = False,
    to: int | None = None,
) -> Champion:
    """Make the newest bundle of a machine its champion, or go back to a version.

    ``why`` goes into ``champions.json``; ``by`` is git's user where it is empty; ``anyway`` lets
    one serve that is not shown to be better; ``to`` is a registered version, without a comparison.
    Raises ValueError when there is no reason, no challenger or no such version, or the challenger
    fails.
    """
    if not why.strip():
        raise ValueError(f"a champion of {machine} needs a reason: give it with --why")
    champions, names = read_champions(root / CHAMPIONS), _names(machine, root)
    now, chosen = _refilled(machine, names, root), champions.machines.get(machine)
    if to is None:
        champions, sha256, note = _challenge(machine, champions, now, names, root, anyway)
        why = f"{why} ({note})" if note else why
    else:
        sha256 = _of_version(machine, to, root)
    if chosen is not None and sha256 == chosen.bundle:
        raise ValueError(f"version {chosen.version} of {machine} is its champion already")
    number = next(v.version for v in versions(machine, root) if v.bundle == sha256)
    name_versions(machine, root, previous=now.bundle if now and now.bundle != sha256 else None)
    name_versions(machine, root, champion=sha256)
    champion = Champion(
        version=number, bundle=sha256, since=_utc_now(), by=by or person(root), why=why
    )
    note_promotion(machine, root, champion)
    models = root / DATA / "models" / machine
    fill_champion(sha256, names, models, root / DATA / "champion" / machine, root=root)
    write_champions(champions.promoted(machine, champion), root / CHAMPIONS)
    newest = newest_bundle(models, names)
    other = newest.sha256 if newest is not None and newest.sha256 != sha256 else None
    name_versions(machine, root, challenger=other)
    return champion


def _utc_now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def person(root: Path) -> str:
    """Who works here: git's user, else that of the system."""
    return git("config", "user.name", root=root) or os.environ.get("USER") or getpass.getuser()


def _of_version(machine: str, number: int, root: Path) -> str:
    known = versions(machine, root)
    found = [v.bundle for v in known if v.version == number]
    if not found:
        there = ", ".join(str(v.version) for v in known) or "none"
        raise ValueError(f"{machine} has no version {number}; there are {there}")
    return found[0]


def _params(root: Path) -> dict[str, Any]:
    from pipeline.parameters import PARAMS, read_params

    return read_params(root / PARAMS)


def _names(machine: str, root: Path) -> tuple[str, ...]:
    from pipeline.fleet import Fleet
    from pipeline.parameters import structure

    return structure(_params(root), "fleet", Fleet).submodels_of(machine)


def _challenge(
    machine: str,
    champions: Champions,
    now: Champion | None,
    names: Sequence[str],
    root: Path,
    anyway: bool,
) -> tuple[Champions, str, str]:
    """Hold the newest bundle against the champion; champions with looks, its hash, and a note."""
    from pipeline.submodels.promotion import objections, sealed_objections

    if not names:
        raise ValueError(f"{machine} has no sub-model in this fleet: see fleet in params.yaml")
    models = root / DATA / "models" / machine
    challenger = bundle_of(models, machine, names)
    if now is None:
        raise ValueError(f"{machine} has no champion yet: run `dvc repro` to register the first")
    if now.bundle == challenger.sha256:
        raise ValueError(f"{machine} has no challenger: run `dvc repro` on new records to make one")
    serves = root / DATA / "champion" / machine
    champion = fill_champion(now.bundle, names, models, serves, root=root)
    register(challenger, models, root, made_with=lambda: made_with(machine, names, root))
    both = [n for n, one in challenger.submodels.items()
            if n in champion.submodels and champion.submodels[n].sha256 != one.sha256]  # fmt: skip
    against = objections(
        _contests(machine, both, root, ("golden", "held_out")),
        statuses={name: one.status for name, one in challenger.submodels.items()},
        added=[n for n in challenger.submodels if n not in champion.submodels],
        absent=[n for n in champion.submodels if n not in challenger.submodels],
    )
    sets = _sets(machine, root)
    if sets is not None and sets.sealed is not None and (anyway or not against):
        contests = _contests(machine, both, root, ("sealed",))
        look = SealedLook(
            machine=machine,
            bundle=challenger.sha256,
            sealed=sets.sealed.sha256,
            at=_utc_now(),
            outcome="; ".join(one.words for one in contests) or "no sub-model differs",
        )
        champions = champions.looked(look)
        write_champions(champions, root / CHAMPIONS)  # a look counts, whatever comes of it
        against += sealed_objections(contests)
    if against and not anyway:
        raise ValueError(f"the newest bundle of {machine} may not serve: {'; '.join(against)}")
    return champions, challenger.sha256, f"anyway: {'; '.join(against)}" if against else ""


def _sets(machine: str, root: Path) -> GoldenSets | None:
    return read_golden(root / DATA / "golden" / f"{machine}.json")


def _contests(
    machine: str, names: Sequence[str], root: Path, roles: tuple[Role, ...]
) -> "list[Contest]":
    """Champion against challenger in some sub-models, with the settings of params.yaml."""
    from pipeline.parameters import section_path, structure
    from pipeline.submodels.cases import Records
    from pipeline.submodels.contract import sections, submodel
    from pipeline.submodels.promotion import PromotionSettings, contest

    values, data, settings = _params(root), root / DATA, PromotionSettings()
    if "promotion" in values:
        settings = structure(values, "promotion", PromotionSettings)
    places = {
        "raw": data / "raw" / machine,
        "signals": data / "signals" / machine,
        "clean": data / "clean" / machine,
        "manifest": data / "signals" / machine / "manifest.json",
    }
    found = []
    for name in names:
        one = submodel(name)
        judging = {
            section: structure(values, section_path(values, section, machine), wanted)
            for section, wanted in sections(one.judging).items()
        }
        found.append(
            contest(
                one, one.judging(**judging), Records(**{key: places[key] for key in one.reads}),
                sets=_sets(machine, root), champion=data / "champion" / machine / name,
                challenger=data / "models" / machine / name, tolerance=settings.tolerance,
                roles=roles,
            )
        )  # fmt: skip
    return found


def made_with(machine: str, names: Sequence[str], root: Path) -> dict[str, Any]:
    """Sections of params.yaml that the sub-models of a machine were made with, by sub-model."""
    from pipeline.parameters import section_path
    from pipeline.submodels.contract import sections, submodel

    values = _params(root)
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
    ``serving`` and ``challenger`` (versions).  A missing champion is filled into the store first.
    """
    if not names:
        keys = ("origin", "sub-model", "latest", "champion", "serving", "challenger")
        return [{"machine": machine, **dict.fromkeys(keys, "-"), "latest": NO_SUBMODEL}]
    champion = _refilled(machine, names, root)
    numbers = {v.bundle: v.version for v in reversed(versions(machine, root))}
    serves = stored_bundle(root / DATA / "champion" / machine, machine)
    newest = newest_bundle(root / DATA / "models" / machine, names)
    other = champion is not None and newest is not None and newest.sha256 != champion.bundle
    since = f" since {champion.since[:10]}" if champion and champion.since else ""
    rows = []
    for name in names:
        path = root / DATA / "models" / machine / name / VERDICT
        verdict = read_json(path, Verdict) if path.exists() else None
        held = serves.submodels.get(name) if serves else None
        rows.append(
            {
                "machine": machine,
                "origin": verdict.origin if verdict else "-",
                "sub-model": name,
                "latest": verdict.status if verdict else "not built: run `dvc repro`",
                "champion": held.status if held else "-",
                "serving": f"version {champion.version}{since}" if champion else "-",
                "challenger": f"version {numbers.get(newest.sha256, '-')}"
                if other and newest
                else "-",
            }
        )
    return rows
