"""An optimisation as a document: what ``kerf optimise`` writes, prints and draws."""

from collections import Counter
from dataclasses import asdict
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.document_groups import Side, group_rows
from pipeline.optimisation.document_trace import load_trace, tool_spans
from pipeline.optimisation.limits_passed import passed, passed_by_limit
from pipeline.optimisation.optimise import Result
from pipeline.optimisation.problem.constraints import CONSTRAINTS
from pipeline.optimisation.proof.prove import with_proof_comment
from pipeline.optimisation.search.baselines import Method
from pipeline.twin.cut_document import assessed, not_known, notes
from pipeline.twin.cut_tables import figure, summary

Floats = NDArray[np.float64]

ROUNDING = 1e-9
"""What an evaluation may pass limits by and keep them, as a share [1]."""
KEYS = ("time_s", "cost", "energy_kWh", "tool_life_share")
"""Of the objectives, in their order."""
GAINS = {"time_s": "time_percent", "cost": "cost_percent", "energy_kWh": "energy_percent",
         "tool_life_share": "tool_life_percent"}  # fmt: skip


def optimised_text(result: Result) -> bytes:
    """The program to write: with the proof in a comment at its end where that is asked for."""
    text = result.answer.text
    return with_proof_comment(text, result.proof) if result.job.settings.proof_comment else text


def optimised_document(
    result: Result, *, machine: str, origin: str, control: str
) -> dict[str, Any]:  # fmt: skip
    """What an optimisation found, as JSON holds it; what is not known is None.

    Parameters
    ----------
    result : Result
        Of :func:`~pipeline.optimisation.optimise.optimise`.
    machine : str
        Its name.
    origin : str
        ``simulated`` or ``recorded``: of the machine's records.
    control : str
        ``identified``, or ``conf/machine`` where the control's values are as written there.
    """
    job, basis = result.job, result.job.basis
    before, after = _sides(result)
    totals = [_totals(side, result) for side in (before, after)]
    groups = group_rows(result, before, after)
    return {
        "program": job.program.name.rpartition("/")[2],
        "machine": machine,
        "origin": origin,
        "control": control,
        "objective": job.objective,
        "currency": None if basis.rates is None else basis.rates.currency,
        "stock": basis.stock,
        "material": basis.material.name,
        "tool_table": basis.table,
        "limits": _limits(result),
        "certainty": _certainty(result),
        "before": totals[0],
        "after": totals[1],
        "gain": {name: _change(totals[0][key], totals[1][key]) for key, name in GAINS.items()},
        "methods": [_method(one) for one in result.methods],
        "front": _front(result),
        "groups": groups,
        "binding": _binding(result, after),
        "held": [asdict(one) for one in result.problem.editable.held],
        "words": _words(result),
        "proof": _proof(result),
        "trace": {
            "before": load_trace(before.cut),
            "after": load_trace(after.cut),
            "tools": tool_spans(before.cut),
        },
        "verified": _verified(result),
        "interrupted": result.interrupted,
        "not_known": _not_known(result, after),
        "notes": notes(after.of, basis),
    }


def _sides(result: Result) -> tuple[Side, Side]:
    """As programmed and optimised, each with what every row of the first costs and takes."""
    basis, answer = result.job.basis, result.answer
    before, after = assessed(result.before, basis), assessed(answer.cut, basis)
    own = np.arange(len(result.moves))
    return (
        Side.of_rows(result.before, before, own),
        Side.of_rows(answer.cut, after, answer.rows),
    )


def _totals(side: Side, result: Result) -> dict[str, Any]:
    found = summary(side.of.found)
    cost, limits = found["cost"], result.job.limits
    beyond = {name: int(of.sum()) for name, of in passed_by_limit(side.of, limits).items()}
    return {
        "time_s": found["time_s"],
        "cost": None if cost is None else cost["sum"],
        "energy_kWh": found["energy_kWh"],
        "tool_life_share": found["tool_life_share"],
        "peak_load_N": found["peak_load_N"],
        "peak_line": found["peak_line"],
        "beyond": int(passed(side.of, limits).sum()),
        "beyond_of": {name: many for name, many in beyond.items() if many},
    }


def _change(before: float | None, after: float | None) -> float | None:
    if before is None or after is None or before <= 0:
        return None
    return figure(100 * (after / before - 1), 4)


def _limits(result: Result) -> dict[str, Any]:
    found = asdict(result.job.limits)
    return {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in found.items() if value is not None
    }  # fmt: skip


def _objectives(values: Floats) -> dict[str, float | None]:
    return {key: figure(float(v)) for key, v in zip(KEYS, values.tolist(), strict=True)}


def _method(method: Method) -> dict[str, Any]:
    return {
        "method": method.name,
        **_objectives(method.objectives),
        "feasible": bool(method.violation <= ROUNDING),
        "evaluations": method.evaluations,
    }


def _front(result: Result) -> list[dict[str, Any]]:
    front = result.front
    if front is None:
        return []
    return [
        {**_objectives(values), "knee": k == front.knee, "no_worse": bool(front.no_worse[k])}
        for k, values in enumerate(front.objectives)
    ]


def _certainty(result: Result) -> dict[str, Any] | None:
    risk, settings = result.risk, result.job.settings.certainty
    if risk is None or result.uncertain is None:
        return None
    return {
        "epsilon": settings.epsilon,
        "exceedance": figure(risk.probability),
        "interval_95": [figure(end) for end in risk.interval_95],
        "draws": risk.draws,
        "peaks": [
            {"share": float(share), "load_N": figure(load)}
            for share, load in sorted(risk.peak_quantiles.items())
        ],
        **_price(result),
        "uncertain": [dict(row) for row in result.uncertain.rows()],
    }


def _price(result: Result) -> dict[str, Any]:
    """What certainty costs: the direct solution with it beside that without it."""
    direct = next((one for one in result.methods if one.name == "direct"), None)
    if result.nominal is None or direct is None:
        return {"nominal": None, "price": None}
    sure, nominal = _objectives(direct.objectives), _objectives(result.nominal.objectives)
    price: dict[str, float | None] = {}
    for key, name in (("time_s", "time"), ("cost", "cost")):
        a, b = nominal[key], sure[key]
        price[key] = None if a is None or b is None else figure(b - a)
        price[f"{name}_percent"] = _change(a, b)
    return {"nominal": {key: nominal[key] for key in ("time_s", "cost")}, "price": price}


def _binding(result: Result, after: Side) -> list[dict[str, Any]]:
    """What binds how many of the blocks that cut, and how long those take; the longest first."""
    decision = result.answer.decision
    binds = result.problem.binding(decision.row_feeds, decision.row_speeds)
    cuts = result.problem.cuts
    found = [
        {
            "limit": CONSTRAINTS[k] if k >= 0 else None,
            "blocks": int(mine.sum()),
            "time_s": figure(float(after.time[mine].sum())),
        }
        for k in np.unique(binds[cuts]).tolist()
        for mine in [cuts & (binds == k)]
    ]
    return sorted(found, key=lambda row: -row["time_s"])


def _words(result: Result) -> dict[str, int]:
    counts = Counter(
        (change.letter, "added" if change.before is None else "changed")
        for change in result.answer.changes
    )
    return {f"{letter}_{what}": counts[letter, what]
            for letter in "FS" for what in ("changed", "added")}  # fmt: skip


def _proof(result: Result) -> dict[str, Any]:
    proof = result.proof
    return {
        "same": proof.same,
        "sha256": proof.sha256,
        "moves": proof.moves,
        "before_sha256": sha256(result.job.program.data).hexdigest(),
        "after_sha256": sha256(optimised_text(result)).hexdigest(),
        "first": None if proof.first is None else str(proof.first),
    }


def _verified(result: Result) -> dict[str, Any]:
    found, moves = result.answer.verified, result.answer.cut.plan.path.moves
    worst, lags = found.peak_row, found.following_um
    return {
        "peak_load_N": figure(found.peak_N) if worst >= 0 else None,
        "peak_line": int(moves.line[worst]) if worst >= 0 else None,
        "following_um": {axis: figure(um) for axis, um in lags.items()} if lags else None,
        "full_evaluations": result.evaluated,
        "tightened": result.tightened,
    }


def _not_known(result: Result, after: Side) -> list[dict[str, str]]:
    found = not_known(after.of, result.job.basis)
    why = result.answer.verified.following_reason
    return [*found, *([{"what": "following errors", "why": why}] if why else [])]
