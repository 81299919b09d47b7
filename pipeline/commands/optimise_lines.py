"""What ``kerf optimise`` says of a part program that it made better."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

NONE = "-"
TOTALS = (
    ("time", "s", "time_s", 1, "time_percent"),
    ("cost", None, "cost", 1, "cost_percent"),
    ("energy", "kWh", "energy_kWh", 1, "energy_percent"),
    ("tool life", "%", "tool_life_share", 100, "tool_life_percent"),
    ("peak load", "N", "peak_load_N", 1, None),
    ("beyond", "blocks", "beyond", 1, None),
)
"""Name, unit (the currency where None), key, factor, key of the change."""


def optimise_lines(document: Mapping[str, Any]) -> Iterator[str]:
    """Before and after, certainty, methods, what binds, what was changed, what is not known."""
    label = " (simulated)" if document["origin"] == "simulated" else ""
    source = "identified" if document["control"] == "identified" else "as in conf, times unproven"
    yield (
        f"{document['program']} on {document['machine']}{label}, control {source}: "
        f"{document['objective']}, {document['stock']} in {document['material']}"
    )
    if document["interrupted"]:
        yield "interrupted: the best that was found until then"
    yield from _totals(document)
    yield from _certainty(document)
    yield from _methods(document)
    yield from _binding(document)
    yield from _changes(document)
    for one in document["held"]:
        yield f"  held: {one['reason']}, {_many(one['rows'], 'move')}, the first in {one['first']}"
    for one in document["not_known"]:
        yield f"  not known: {one['what']}, {one['why']}"


def _totals(document: Mapping[str, Any]) -> Iterator[str]:
    before, after, gain = document["before"], document["after"], document["gain"]
    rows = [["", "", "before", "after", "change"]]
    for name, unit, key, factor, change in TOTALS:
        told = document["currency"] if unit is None else unit
        values = [_number(side[key], factor, 4) for side in (before, after)]
        rows.append([name, str(told or ""), *values, _change(gain[change]) if change else NONE])
    yield from _table(rows, words=2)


def _certainty(document: Mapping[str, Any]) -> Iterator[str]:
    found = document["certainty"]
    if found is None:
        return
    limit = document["limits"].get("load_N")
    low, high = (_percent(end) for end in found["interval_95"])
    yield (
        f"  certainty: P(load > {_number(limit)} N) = {_percent(found['exceedance'])} "
        f"({low} to {high}), at most {_percent(found['epsilon'])} asked, "
        f"{_many(found['draws'], 'draw')}"
    )
    price = found["price"]
    if price is not None:
        cost = "" if price["cost"] is None else (
            f", {_number(price['cost'])} {document['currency']} ({_change(price['cost_percent'])})"
        )  # fmt: skip
        yield (
            f"  its price: {_number(price['time_s'])} s ({_change(price['time_percent'])}){cost} "
            "against the optimum that takes every value as known"
        )


def _methods(document: Mapping[str, Any]) -> Iterator[str]:
    currency = str(document["currency"] or "")
    rows = [
        ["method", "limits", "time", "cost", "energy", "tool life", "evaluations"],
        ["", "", "s", currency, "kWh", "%", ""],
    ]
    rows += [
        [
            one["method"],
            "inside" if one["feasible"] else "beyond",
            _number(one["time_s"], 1, 4),
            _number(one["cost"], 1, 4),
            _number(one["energy_kWh"]),
            _number(one["tool_life_share"], 100),
            str(one["evaluations"]),
        ]
        for one in document["methods"]
    ]
    yield from _table(rows, words=2)
    knee = next((k for k, one in enumerate(document["front"], 1) if one["knee"]), None)
    if knee is not None:
        front = document["front"]
        better = sum(one.get("no_worse") is True for one in front)
        of = f"of the {better} no worse" if better else "of all, none being no worse"
        yield f"  front: {_many(len(front), 'program')}; knee: number {knee}, {of} than before"


def _binding(document: Mapping[str, Any]) -> Iterator[str]:
    for one in document["binding"]:
        what = one["limit"] or "nothing"
        yield f"  binds: {what:<16} {_many(one['blocks'], 'block')}, {_number(one['time_s'])} s"


def _changes(document: Mapping[str, Any]) -> Iterator[str]:
    words, proof = document["words"], document["proof"]
    parts = ", ".join(f"{n} {key[0]} {key[2:]}" for key, n in words.items() if n)
    yield f"  words: {parts or 'none changed'}"
    if proof["same"]:
        yield (
            f"  proof: {_many(proof['moves'], 'move')} the same to the last bit, "
            f"sha256 {proof['sha256']}"
        )
    else:
        yield f"  proof: NOT the same, first difference {proof['first']}"
    verified = document["verified"]
    if verified["peak_load_N"] is not None:
        where = "" if verified["peak_line"] is None else f" in line {verified['peak_line']}"
        yield (
            f"  whole twin: peak load {_number(verified['peak_load_N'])} N{where}, "
            f"{_many(verified['full_evaluations'], 'evaluation')}, "
            f"{_many(verified['tightened'], 'round')} of tightening"
        )


def _table(rows: Sequence[Sequence[str]], *, words: int) -> Iterator[str]:
    """Lines whose columns stand under each other; the first ``words`` columns are left aligned."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = [
            word.ljust(width) if i < words else word.rjust(width)
            for i, (word, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield f"  {'  '.join(cells)}".rstrip()


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _number(value: float | None, factor: float = 1, digits: int = 3) -> str:
    if value is None:
        return NONE
    if isinstance(value, int):
        return str(int(value * factor))
    shown = value * factor
    return f"{shown:.0f}" if abs(shown) >= 10**digits else f"{shown:.{digits}g}"


def _change(value: float | None) -> str:
    return NONE if value is None else f"{value:+.1f} %"


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{100 * value:.2g} %"
