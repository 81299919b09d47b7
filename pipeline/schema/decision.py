"""Decision on a challenger: each rule of the gate with its figures, result and words.

Rules are judged in the order of :data:`RULES`.  A challenger may serve when none is broken and
"better" is kept; what has no data, and what lies within the spread of trainings, is said.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from pipeline.schema.ranges import NotNegative, Ranged
from pipeline.schema.verdict import Status

RuleName = Literal[
    "complete", "unseen", "canaries", "no new failure", "not worse", "newest day", "better",
    "sealed",
]  # fmt: skip
Result = Literal["kept", "broken", "not decided", "no data"]
Against = Literal["better", "worse", "equal", "not decided"]

RULES: Mapping[RuleName, str] = {
    "complete": "has every sub-model that serves",
    "unseen": "was fitted on nothing that is frozen",
    "canaries": "sees nothing of what it predicts",
    "no new failure": "fails in nothing that passed",
    "not worse": "is worse in nothing on the golden set, over all groups and in each",
    "newest day": "is not worse on the newest day of continuous records",
    "better": "is better in at least one sub-model that serves",
    "sealed": "neither fails nor is worse on the sealed set",
}
"""Rules, in words that follow "the challenger"."""


@dataclass(frozen=True, kw_only=True)
class PromotionSettings(Ranged, section="promotion"):
    """Tolerances of a promotion, and how long the one before stays warm."""

    tolerance: NotNegative = 0.05
    """Greatest rise of the mean absolute error of any target over the champion's [1]."""
    group_tolerance: NotNegative = 0.5
    """Greatest rise in a single group (day, recording, tool), over the champion's mean [1]."""
    warm_hours: NotNegative = 48.0
    """Time for which the one before can be taken back at once and cannot be deleted [h]."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Target of a sub-model, predicted by champion and challenger on the same cases."""

    submodel: str
    quantity: str
    regime: str
    unit: str
    """Target, with its sub-model and unit."""
    groups: int
    """Groups (days, recordings, tools) that both predicted."""
    champion: float
    challenger: float
    """Mean absolute error, averaged over the groups [unit]."""
    result: Against
    """Challenger against champion; "not decided" where the difference is within the spread of
    trainings with other seeds."""
    worst_group: str = ""
    """Group in which alone it is worse than the tolerance of a group; empty where there is none."""

    @property
    def words(self) -> str:
        """The comparison as a sentence without its verdict."""
        regime = f", {self.regime}" if self.regime else ""
        groups = "1 group" if self.groups == 1 else f"{self.groups} groups"
        alone = f", worst in {self.worst_group}" if self.worst_group else ""
        return (
            f"{self.submodel} ({self.quantity}{regime}): mean error {self.challenger:.4g} "
            f"{self.unit} against the champion's {self.champion:.4g} {self.unit} over {groups}"
            f"{alone}"
        )


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One rule of the gate: its result, the words that explain it, and its figures."""

    name: RuleName
    result: Result
    words: tuple[str, ...] = ()
    figures: tuple[Compared, ...] = ()

    @property
    def sentence(self) -> str:
        """The rule's words in one line."""
        return "; ".join(self.words)


@dataclass(frozen=True, kw_only=True)
class Side:
    """Champion or challenger of a decision; ``statuses`` are the verdicts of its sub-models."""

    version: int
    bundle: str
    statuses: Mapping[str, Status] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The document of a decision."""

    machine: str
    origin: str
    """Machine, and origin of its records."""
    champion: Side
    challenger: Side
    changed: tuple[str, ...]
    """Sub-models that differ between the two."""
    golden: str
    """SHA-256 of the golden set; empty where none was frozen."""
    rules: tuple[Rule, ...]
    serving: tuple[str, ...] = ()
    """Sub-models of the challenger that serve when it is promoted."""
    at: str = ""
    by: str = ""
    why: str = ""
    anyway: bool = False
    """When, by whom and why it was decided, and whether against the rules."""

    @property
    def against(self) -> tuple[Rule, ...]:
        """Rules that keep the challenger from serving."""
        return tuple(
            one for one in self.rules
            if one.result == "broken" or (one.name == "better" and one.result != "kept")
        )  # fmt: skip

    @property
    def may_serve(self) -> bool:
        """Whether the rules let the challenger serve."""
        return not self.against

    @property
    def promoted(self) -> bool:
        """Whether it serves: the rules let it, or somebody said anyway."""
        return self.may_serve or self.anyway

    @property
    def overridden(self) -> bool:
        """Whether it serves against the rules."""
        return self.anyway and not self.may_serve

    @property
    def unproven(self) -> str:
        """Sub-models that serve by it without having passed: ``"drive failed, …"``."""
        return self._named(name for name in self.serving if name in self.challenger.statuses)

    @property
    def idle(self) -> str:
        """Sub-models that do not serve by it, with their status."""
        return self._named(name for name in self.challenger.statuses if name not in self.serving)

    def _named(self, names: Iterable[str]) -> str:
        statuses = {name: self.challenger.statuses[name] for name in names}
        return ", ".join(f"{name} {one}" for name, one in statuses.items() if one != "passed")

    @property
    def broken(self) -> str:
        """Names of the rules that keep it from serving: ``"rule 'better'"``, ``"rules …"``."""
        names = ", ".join(repr(one.name) for one in self.against)
        return f"rule{'s' if len(self.against) > 1 else ''} {names}"

    @property
    def objections(self) -> str:
        """What speaks against the challenger, each with the rule's name; empty where nothing."""
        return "; ".join(
            f"rule {one.name!r} is {one.result}: {one.sentence}" for one in self.against
        )

    @property
    def metrics(self) -> dict[str, float]:
        """Figures for the registry: 1 for a rule that is kept, 0 for another, errors, gains [%]."""
        found = {"gate/may serve": float(self.may_serve), "gate/anyway": float(self.anyway)}
        for rule in self.rules:
            if rule.result != "no data":
                found[f"gate/{rule.name}"] = float(rule.result == "kept")
            for one in rule.figures:
                about = " ".join(filter(None, (one.submodel, one.quantity, one.regime)))
                key = f"gate/{rule.name}/{about}"
                found |= {f"{key}/champion": one.champion, f"{key}/challenger": one.challenger}
                if one.champion:
                    gain = 100 * (1 - one.challenger / one.champion)
                    found[f"{key}/gain_percent"] = gain
        return found
