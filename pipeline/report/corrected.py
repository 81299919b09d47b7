"""Section on corrected commands: following errors on the shop floor before and after."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, joined, number, percent
from pipeline.charts.sections import Section
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Head, Table, sources

MADE_FROM = "both commands of each program, driven on the simulated shop floor"
MOVES_UM = 1.0
"""Following error of an axis that moves in cuts, RMS [um]; less is that of one that stands."""
PLACES = {"measured": "at the loop’s sensor", "carriage": "at the carriage"}
"""Place of the error: at the sensor that closes the loop, and at the carriage itself."""


def corrected_section(path: Path | None, shelf: SourceRegistry) -> Section | None:
    """Following error of each axis with the command as planned and as corrected, from the JSON."""
    if path is None:
        return None
    document = shelf.document(path, MADE_FROM)
    if document is None:
        return None
    programs: dict[str, Any] = document["programs"]
    rows = [row for name, one in programs.items() for row in _rows(name, one)]
    if not rows:
        return None
    refused = [f"{name}: {one['refused']}" for name, one in programs.items() if "refused" in one]
    heads = [
        Head(name="Program"), Head(name="Axis"), Head(name="Error"), Head(name="Where"),
        *(
            Head(name=name, unit="µm", numeric=True, group=group)
            for group in ("as planned", "corrected") for name in ("RMS", "greatest")
        ),
        Head(name="left of RMS", numeric=True),
    ]  # fmt: skip
    table = Table(
        caption=f"Following error on the shop floor, {len(rows)} rows", heads=heads, rows=rows,
        folded=True, sources=sources(shelf, path),
        note="; ".join(["Mean of runs with different noise, nothing is cut", *refused]) + ".",
    )  # fmt: skip
    text = [*_gain(programs), *_rapids(programs)]
    return Section(key="corrected", title="Corrected commands", text=text, blocks=[table])


def _gain(programs: dict[str, Any]) -> Iterator[str]:
    """Remaining following error of axes that move in cuts."""
    in_cuts = [
        axis["measured"].get("cutting", axis["measured"])
        for one in programs.values()
        for axis in one.get("axes", {}).values()
    ]
    moved = [one for one in in_cuts if one["before"]["rms_um"]["mean"] >= MOVES_UM]
    shares = [_mean(one["share_left"]) for one in moved]
    still = len(in_cuts) - len(moved)
    beside = (
        f", but for {counted(still, 'axis', 'axes')} below {MOVES_UM:g} µm as planned"
        if still else ""
    )  # fmt: skip
    if shares:
        yield (
            f"Driven on the simulated shop floor, the corrected commands leave "
            f"{_share(min(shares))} to {_share(max(shares))} of the axes’ following error in cuts "
            f"(RMS at the loop’s sensor{beside}). They were made from the models alone, "
            "before the motion; "
            "kerf simulate PROGRAM --machine M --compensate FILE makes them for a program of yours."
        )


def _rapids(programs: dict[str, Any]) -> Iterator[str]:
    """Effect on rapids, and a warning where the path as a whole is further off."""
    yield (
        "Rapids are commanded as planned, since their axes are at their limits: the correction "
        "fades out after a cut and in before the next, for all axes at the same time."
    )
    off = [
        f"{name} by {number(place['after']['max_um']['mean'], 2)} µm"
        for name, one in programs.items()
        if (place := one.get("path", {}).get("measured"))
        and _mean(place["share_left"] or 0.0) > 1
    ]  # fmt: skip
    if off:
        yield f"The whole path is further off than as planned in {joined(off)} at most."


def _share(part: float) -> str:
    return percent(part, 1.0) if part <= 1 else f"{100 * part:.0f}{NARROW}%"


def _rows(name: str, one: dict[str, Any]) -> list[list[Cell]]:
    """Rows of one program: each axis at each place, then the path."""
    found = []
    things = [*one.get("axes", {}).items(), *([("path", one["path"])] if one.get("path") else [])]
    for axis, places in things:
        for place, words in PLACES.items():
            whole = places.get(place)
            parts = {} if whole is None else {"in cuts": whole.get("cutting"), "whole": whole}
            for where, part in parts.items():
                if part is not None:
                    found.append([Cell(text=t) for t in (name, axis, words, where, *_cells(part))])
    return found


def _cells(part: dict[str, Any]) -> list[str]:
    """RMS and greatest error before and after, and what is left of the RMS."""
    left = part["share_left"]
    numbers = [
        number(part[when][key]["mean"], 3)
        for when in ("before", "after") for key in ("rms_um", "max_um")
    ]  # fmt: skip
    return [*numbers, NOT_KNOWN if left is None else _share(_mean(left))]


def _mean(value: Any) -> float:
    return float(value["mean"] if isinstance(value, dict) else value)
