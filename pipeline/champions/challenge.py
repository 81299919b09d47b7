"""Challenger against champion: what is compared, and the decision that follows."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.champions.serving import (
    DATA,
    fill_champion,
    made_with,
    names_of,
    params_of,
    serving_of,
)
from pipeline.registry.loading import checked_place
from pipeline.registry.runs import register
from pipeline.registry.store import name_versions, versions
from pipeline.schema.bundle import BUNDLE, Bundle, Champion, bundle_of
from pipeline.schema.decision import Decision, Side
from pipeline.schema.golden import GoldenSets, read_golden
from pipeline.schema.store import read_json
from pipeline.submodels.promotion import (
    Contest,
    Look,
    PromotionSettings,
    contest,
    first_rules,
    sealed_rule,
)

if TYPE_CHECKING:
    from pipeline.submodels.cases import Records


def promotion_settings(root: Path) -> PromotionSettings:
    """Tolerances in params.yaml, or the usual ones."""
    from pipeline.parameters import structure

    values = params_of(root)
    if "promotion" not in values:
        return PromotionSettings()
    return structure(values, "promotion", PromotionSettings)


def decide(
    machine: str,
    now: Champion | None,
    root: Path = Path(),
    *,
    to: int | None = None,
    anyway: bool = False,
    seal: bool = True,
) -> tuple[Decision, str]:
    """Judge the newest bundle, or registered version ``to``, against the champion.

    With ``seal`` the sealed set is looked at where all other rules are kept, or with ``anyway``.
    The second value is the hash of the sealed set where it was looked at, else empty.
    Raises ValueError when there is no champion, no challenger or no such version.
    """
    names = names_of(machine, root)
    folder, challenger = _challenger(machine, names, root, to)
    if now is None:
        raise ValueError(f"{machine} has no champion yet: run `dvc repro` to register the first")
    serves, models = root / DATA / "champion" / machine, root / DATA / "models" / machine
    if now.bundle == challenger.sha256:
        if to is not None:
            raise ValueError(f"version {to} of {machine} is its champion already")
        raise ValueError(f"{machine} has no challenger: run `dvc repro` on new records to make one")
    champion = fill_champion(now.bundle, names, models, serves, root=root)
    version = register(challenger, folder, root, made_with=lambda: made_with(machine, names, root))
    if to is None:
        name_versions(machine, root, challenger=challenger.sha256)
    both = [n for n, one in challenger.submodels.items()
            if n in champion.submodels and champion.submodels[n].sha256 != one.sha256]  # fmt: skip
    serving = tuple(name for name in champion.submodels if now.serves(name))
    sets = read_golden(root / DATA / "golden" / f"{machine}.json")

    def met(look: Look) -> list[Contest]:
        return _contests(machine, both, (serves, folder), root, sets=sets, look=look)

    rules = first_rules(
        met("golden"), met("newest day"),
        champion=champion, challenger=challenger, serving=serving,
    )  # fmt: skip
    decision = Decision(
        machine=machine, origin=challenger.origin,
        champion=_side(now.version, champion), challenger=_side(version.version, challenger),
        changed=tuple(both), golden=sets.golden.sha256 if sets and sets.golden else "",
        rules=tuple(rules), serving=_serving(champion, serving, challenger, anyway), anyway=anyway,
    )  # fmt: skip
    if not (seal and sets and sets.sealed and (anyway or decision.may_serve)):
        return decision, ""
    last = sealed_rule(met("sealed"), serving)
    return replace(decision, rules=(*rules, last)), sets.sealed.sha256


def _challenger(
    machine: str, names: Sequence[str], root: Path, to: int | None
) -> tuple[Path, Bundle]:
    """Folder and bundle of the newest models, or of a registered version."""
    if not names:
        raise ValueError(f"{machine} has no sub-model in this fleet: see fleet in params.yaml")
    if to is None:
        models = root / DATA / "models" / machine
        return models, bundle_of(models, machine, names)
    known = versions(machine, root)
    found = [v for v in known if v.version == to]
    if not found:
        there = ", ".join(str(v.version) for v in known) or "none"
        raise ValueError(f"{machine} has no version {to}; there are {there}")
    folder = checked_place(found[0], root) / "artifacts" / "bundle"
    return folder, read_json(folder / BUNDLE, Bundle)


def _side(version: int, bundle: Bundle) -> Side:
    return Side(version=version, bundle=bundle.sha256,
                statuses={name: one.status for name, one in bundle.submodels.items()})  # fmt: skip


def _serving(
    champion: Bundle, serving: Sequence[str], challenger: Bundle, anyway: bool
) -> tuple[str, ...]:
    """Sub-models that serve after a promotion: those that may, and those that fail in both."""
    if anyway:
        return tuple(challenger.submodels)
    able = serving_of(challenger)
    return tuple(
        name for name in challenger.submodels
        if name in able or (name in serving and champion.submodels[name].status == "failed")
    )  # fmt: skip


def _contests(
    machine: str,
    names: Sequence[str],
    sides: tuple[Path, Path],
    root: Path,
    *,
    sets: GoldenSets | None,
    look: Look,
) -> list[Contest]:
    """Contests of some sub-models between the folders of champion and challenger.

    The settings are those of params.yaml.
    """
    from pipeline.submodels.contract import judging_of, submodel

    values, settings = params_of(root), promotion_settings(root)
    found = []
    for name in names:
        one = submodel(name)
        read = [_records(machine, root, own) for own in sides]
        met = contest(
            one, judging_of(one, values, machine), read, sets=sets, champion=sides[0] / name,
            challenger=sides[1] / name, settings=settings, look=look,
        )  # fmt: skip
        found += [met] if met is not None else []
    return found


def _records(machine: str, root: Path, own: Path) -> "Records":
    """Records of a machine; ``own`` is the folder of the bundle, whose models it builds on."""
    from pipeline.fleet import Fleet
    from pipeline.parameters import structure
    from pipeline.submodels.cases import Records

    models = f"data/models/{machine}/drive"
    under = structure(params_of(root), "fleet", Fleet).drives_under.get(machine, models)
    return Records.of_machine(
        root / DATA, machine, drive=own / "drive" if under == models else root / under,
        wear=own / "wear",
    )  # fmt: skip
