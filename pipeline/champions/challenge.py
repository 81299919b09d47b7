"""Challenger against champion: what is compared, and the decision that follows."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from pipeline.champions.serving import (
    DATA,
    FIRST_BY,
    fill_champion,
    made_with,
    names_of,
    numbered,
    numbers_of,
    params_of,
    promotion_settings,
    serving_of,
    version_numbers,
)
from pipeline.fleet import Fleet
from pipeline.parameters import structure
from pipeline.registry.loading import checked_place
from pipeline.registry.runs import register
from pipeline.registry.store import name_versions
from pipeline.schema.bundle import BUNDLE, VERDICT, Bundle, Champion, bundle_of
from pipeline.schema.decision import Decision, Rule, Side
from pipeline.schema.golden import GoldenSets, read_golden
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.cases import Cases, Records
from pipeline.submodels.contract import judging_of, submodel
from pipeline.submodels.promotion import (
    Contest,
    Files,
    Look,
    contest,
    deciding,
    first_rules,
    sealed_rule,
)


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

    With ``seal`` the bundle is registered, and the sealed set is looked at where all other rules
    are kept; without it nothing changes, and a bundle that is not registered is version 0.
    The second value is the hash of the sealed set where it was looked at, else empty.
    Raises ValueError when there is no champion, no challenger or no such version.
    """
    names = names_of(machine, root)
    folder, challenger = _challenger(machine, names, root, to)
    if now is None:
        raise ValueError(f"{machine} has no champion yet: run `dvc repro` to register the first")
    if now.bundle == challenger.sha256:
        return _accepted(machine, now, challenger, to, anyway=anyway), ""
    champion = fill_champion(machine, now.bundle, names, root)
    if seal:
        made = partial(made_with, machine, names, root)
        known = numbers_of(machine, root)
        register(challenger, folder, root, made_with=made, numbers=known)
        if to is None:
            name_versions(machine, root, challenger=challenger.sha256)
    number = version_numbers(machine, root).get(challenger.sha256, 0)
    before = {name: one.sha256 for name, one in champion.submodels.items()}
    changed = [name for name, one in challenger.submodels.items()
               if before.get(name, one.sha256) != one.sha256]  # fmt: skip
    serving = tuple(name for name in champion.submodels if now.serves(name))
    serve = tuple(n for n in challenger.submodels if n in (*serving_of(challenger), *serving))
    sets = read_golden(root / DATA / "golden" / f"{machine}.json")

    # what neither serves nor would is compared nowhere: nothing rests on it
    both = [name for name in changed if name in serve]
    met = _comparison(machine, both, (root / DATA / "champion" / machine, folder), root, sets)
    rules = first_rules(
        met("golden"), met("newest day"),
        champion=champion, challenger=challenger, serving=serving,
    )  # fmt: skip
    decision = Decision(
        machine=machine, origin=challenger.origin,
        champion=_side(now.version, champion), challenger=_side(number, challenger),
        changed=tuple(changed), golden=sets.golden.sha256 if sets and sets.golden else "",
        rules=tuple(rules), serving=serve, anyway=anyway,
    )  # fmt: skip
    if not (seal and sets and sets.sealed and decision.may_serve):
        return decision, ""
    sealed = met("sealed")
    last = sealed_rule(sealed, serving)
    looked = sets.sealed.sha256 if sealed else ""  # where nothing was compared nothing was seen
    return replace(decision, rules=(*rules, last)), looked


def _accepted(
    machine: str, now: Champion, bundle: Bundle, to: int | None, *, anyway: bool
) -> Decision:
    """Decision on the first bundle, which serves and which nobody had chosen."""
    if to is None:
        raise ValueError(f"{machine} has no challenger: run `dvc repro` on new records to make one")
    if now.by != FIRST_BY:
        raise ValueError(f"version {to} of {machine} is its champion already")
    words = ("it serves already, as the first bundle, which nobody had chosen",)
    rule = Rule(name="complete", result="kept", words=words)
    return Decision(
        machine=machine, origin=bundle.origin, champion=_side(to, bundle),
        challenger=_side(to, bundle), changed=(), golden="", rules=(rule,),
        serving=now.serving or (), anyway=anyway,
    )  # fmt: skip


def _challenger(
    machine: str, names: Sequence[str], root: Path, to: int | None
) -> tuple[Path, Bundle]:
    """Folder and bundle of the newest models, or of a registered version."""
    if not names:
        raise ValueError(f"{machine} has no sub-model in this fleet: see fleet in params.yaml")
    if to is None:
        models = root / DATA / "models" / machine
        return models, bundle_of(models, machine, names)
    folder = checked_place(numbered(machine, to, root), root) / "artifacts" / "bundle"
    return folder, read_json(folder / BUNDLE, Bundle)


def _side(version: int, bundle: Bundle) -> Side:
    return Side(version=version, bundle=bundle.sha256,
                statuses={name: one.status for name, one in bundle.submodels.items()})  # fmt: skip


def _comparison(
    machine: str, names: Sequence[str], folders: tuple[Path, Path], root: Path,
    sets: GoldenSets | None,
) -> Callable[[Look], list[Contest]]:  # fmt: skip
    """Contests of sub-models by look; ``folders`` are the champion's and the challenger's.

    Settings are those of params.yaml.  Cases are read once for all looks.
    """
    values, settings = params_of(root), promotion_settings(root)
    verdicts = [read_json(folders[1] / name / VERDICT, Verdict) for name in names]
    tests = sum(len(deciding(verdict)) for verdict in verdicts)
    under = structure(values, "fleet", Fleet).drives_under.get(machine)

    @cache
    def cases(name: str, records: Records) -> tuple[Cases, Files]:
        one = submodel(name)
        return one.cases(records, judging_of(one, values, machine), sets), records.files

    def records(name: str, own: Path) -> Records:
        """Records that a sub-model reads; ``own`` is the folder of the models it builds on."""
        every = Records.of_machine(
            root / DATA, machine, own, None if under is None else root / under
        )
        return Records(**{one: getattr(every, one) for one in submodel(name).reads})

    def met(look: Look) -> list[Contest]:
        continuous = [name for name in names if "clean" in submodel(name).reads]
        found = [
            contest(
                submodel(name), judging_of(submodel(name), values, machine),
                [partial(cases, name, records(name, own)) for own in folders],
                sets=sets, champion=folders[0] / name, challenger=folders[1] / name,
                settings=settings, look=look, tests=tests,
            )
            for name in (continuous if look == "newest day" else names)
        ]  # fmt: skip
        return [one for one in found if one is not None]

    return met
