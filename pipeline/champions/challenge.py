"""Challenger against champion: what is compared, and the decision that follows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
from pipeline.schema.bundle import BUNDLE, VERDICT, Bundle, Champion, bundle_of
from pipeline.schema.decision import Decision, Side
from pipeline.schema.golden import GoldenSets, read_golden
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.promotion import (
    Contest,
    Look,
    PromotionSettings,
    contest,
    deciding,
    first_rules,
    sealed_rule,
)

if TYPE_CHECKING:
    from pipeline.submodels.cases import Cases, Records
    from pipeline.submodels.promotion import Files


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

    compare = _Sides(machine=machine, folders=(serves, folder), root=root, sets=sets,
                     names=tuple(both))  # fmt: skip

    def met(look: Look) -> list[Contest]:
        return [one for name in both if (one := compare.met(name, look)) is not None]

    rules = first_rules(
        met("golden"), met("newest day"),
        champion=champion, challenger=challenger, serving=serving,
    )  # fmt: skip
    decision = Decision(
        machine=machine, origin=challenger.origin,
        champion=_side(now.version, champion), challenger=_side(version.version, challenger),
        changed=tuple(both), golden=sets.golden.sha256 if sets and sets.golden else "",
        rules=tuple(rules), serving=_serving(serving, challenger, anyway), anyway=anyway,
    )  # fmt: skip
    if not (seal and sets and sets.sealed and (anyway or decision.may_serve)):
        return decision, ""
    sealed = met("sealed")
    last = sealed_rule(sealed, {*serving, *decision.serving})
    looked = sets.sealed.sha256 if sealed else ""  # where nothing was compared nothing was seen
    return replace(decision, rules=(*rules, last)), looked


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


def _serving(serving: Sequence[str], challenger: Bundle, anyway: bool) -> tuple[str, ...]:
    """Sub-models that serve after a promotion: those that passed, and those that do already."""
    if anyway:
        return tuple(challenger.submodels)
    return tuple(
        name for name in challenger.submodels if name in (*serving_of(challenger), *serving)
    )


@dataclass(frozen=True, kw_only=True)
class _Sides:
    """Folders of champion and challenger, compared with the settings of params.yaml."""

    machine: str
    folders: tuple[Path, Path]
    root: Path
    sets: GoldenSets | None
    names: tuple[str, ...]
    """Sub-models that differ."""

    @cached_property
    def tests(self) -> int:
        """Comparisons in all, by the challenger's verdicts."""
        verdicts = [read_json(self.folders[1] / name / VERDICT, Verdict) for name in self.names]
        return sum(len(deciding(verdict)) for verdict in verdicts)

    @cached_property
    def values(self) -> dict[str, Any]:
        return params_of(self.root)

    @cached_property
    def read(self) -> "Callable[[str, Records], tuple[Cases, Files]]":
        """Cases of a sub-model from records, each read once for all looks."""
        from pipeline.submodels.contract import judging_of, submodel

        @cache
        def cases(name: str, records: "Records") -> "tuple[Cases, Files]":
            one = submodel(name)
            judging = judging_of(one, self.values, self.machine)
            return one.cases(records, judging, self.sets), records.files

        return cases

    def met(self, name: str, look: Look) -> Contest | None:
        from pipeline.submodels.contract import judging_of, submodel

        one, (champion, challenger) = submodel(name), self.folders
        return contest(
            one, judging_of(one, self.values, self.machine),
            [partial(self.read, name, self.records(one.reads, own)) for own in self.folders],
            sets=self.sets, champion=champion / name, challenger=challenger / name,
            settings=promotion_settings(self.root), look=look, tests=self.tests,
        )  # fmt: skip

    def records(self, reads: Sequence[str], own: Path) -> "Records":
        """Records that a sub-model reads; ``own`` is the folder of the models it builds on."""
        from pipeline.fleet import Fleet
        from pipeline.parameters import structure
        from pipeline.submodels.cases import Records

        under = structure(self.values, "fleet", Fleet).drives_under.get(self.machine)
        every = Records.of_machine(
            self.root / DATA, self.machine, own, None if under is None else self.root / under
        )
        return Records(**{name: getattr(every, name) for name in reads})
