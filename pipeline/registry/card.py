"""Model card of a bundle in Markdown: purpose, data, verdicts, limits, units."""

from collections.abc import Mapping
from pathlib import Path

from pipeline.schema.bundle import MODEL, VERDICT, Bundle
from pipeline.schema.model import Model
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Score, Verdict

ROLES = {"golden": "golden records", "held_out": "records held out of the fit"}
"""Records that a verdict rests on, in words."""
LONGEST = 5000
"""Characters of a description that every store of MLflow takes."""
MOST = 8
"""Reasons, conditions and cases of a kind that a card names."""


def model_card(bundle: Bundle, folder: Path, units: Mapping[str, Mapping[str, str]]) -> str:
    """Card of a bundle."""
    lines = [
        f"# Digital twin of {bundle.machine} ({bundle.origin} records)",
        "",
        f"Predicts what this one machine does; status: {bundle.status}. Not for another machine, "
        "and not for what no sub-model below was judged on.",
    ]
    if bundle.origin != "recorded":
        lines += ["", "Simulated: its records are of a simulated shop floor, not of a machine."]
    for name in bundle.submodels:
        lines += ["", *_part(name, folder / name, units.get(name, {}))]
    return "\n".join(lines) + "\n"


def as_description(card: str) -> str:
    """A card as MLflow's description: cut at a line where it is too long, and said so."""
    more = "\n\nThe whole card is model_card.md among the run's files.\n"
    if len(card) <= LONGEST:
        return card
    return card[: LONGEST - len(more)].rpartition("\n")[0] + more


def _part(name: str, folder: Path, units: Mapping[str, str]) -> list[str]:
    from pipeline.submodels.contract import submodel

    one = submodel(name)
    verdict = read_json(folder / VERDICT, Verdict)
    model = read_json(folder / MODEL, one.model)
    inputs = ", ".join(f"{i.name} [{i.unit or 1}]" for i in one.inputs) or "see the signature"
    targets = ", ".join(dict.fromkeys(f"{s.quantity} [{s.unit}]" for s in verdict.scores))
    lines = [
        f"## {one.title[:1].upper()}{one.title[1:]} (`{name}`): {verdict.status}",
        "",
        f"- For: {targets or one.title}, from {inputs}.",
        f"- Learnt from: {_trained(model)}.",
        f"- Judged on: {_judged(verdict)}.",
    ]
    lines += [f"  - {_score(score, _limits(score, verdict))}" for score in _decisive(verdict)]
    lines += [f"- Limit: {reason}." for reason in verdict.missed[:MOST]]
    lines += [f"- Beyond what was learnt: {o.case}, {o.condition} {o.value} {o.unit}, learnt "
              f"{o.learnt}." for o in verdict.outside[:MOST]]  # fmt: skip
    unknown = [key for some in model.parameters.values() for key, p in some.items()
               if not p.determined]  # fmt: skip
    if unknown:
        lines.append(f"- Not determined by the records: {', '.join(unknown[:MOST])}.")
    others = ", ".join(f"{column} [{unit}]" for column, unit in sorted(units.items()) if unit)
    return [*lines, f"- Units: {others}."] if others else lines


def _trained(model: Model) -> str:
    cases = [one.case for one in model.trained_on]
    more = f" and {len(cases) - MOST} more" if len(cases) > MOST else ""
    return f"{', '.join(cases[:MOST])}{more}" if cases else "no case"


def _judged(verdict: Verdict) -> str:
    role = verdict.judged_role
    if role is None:
        return "nothing that it had not seen"
    count = len([case for case in verdict.cases if case.role == role])
    golden = verdict.golden
    frozen = f", frozen as {golden.sha256[:12]}" if golden and role == "golden" else ""
    return f"{count} cases of {ROLES.get(role, role)}{frozen}"


def _decisive(verdict: Verdict) -> list[Score]:
    """Scores over all groups that the verdict rests on; none where nothing was judged."""
    return [s for s in verdict.scores
            if s.group == "all" and s.role == verdict.judged_role and s.n]  # fmt: skip


def _limits(score: Score, verdict: Verdict) -> Mapping[str, float]:
    """Limits of a quantity and regime, which may be set for each group alone."""
    about = (score.quantity, score.regime, score.role)
    same = [s for s in verdict.scores if (s.quantity, s.regime, s.role) == about]
    return next((s.limits for s in [score, *same] if s.limits), {})


def _score(score: Score, bounds: Mapping[str, float]) -> str:
    regime = f", {score.regime}" if score.regime else ""
    errors = [
        f"{name.upper()} {value:.4g} {score.unit}".rstrip()
        for name in ("mae", "rmse", "max")
        if (value := getattr(score, name)) is not None
    ]
    limits = [f"{name} {limit:.4g}" for name, limit in bounds.items()]
    held = f" (limits: {', '.join(limits)})" if limits else ""
    inside = ""
    if score.coverage_90 is not None:
        inside = f"; {100 * score.coverage_90:.0f} % inside the 90 % interval"
    return f"{score.quantity}{regime}: {', '.join(errors)}{held}{inside}"
