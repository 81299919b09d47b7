"""Optimisation of a part program on the command line: program, JSON and page."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TypeVar

from pipeline.app.cut import edge_lines, warning_lines
from pipeline.app.output import NONE, aligned, between, label, many, rounded
from pipeline.app.programs import Controlled, verdict_lines
from pipeline.optimisation.document import optimised_part, optimised_text
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.settings import OptimisationSettings
from pipeline.report.optimised.page import write_optimised_page
from pipeline.report.provenance import Made
from pipeline.schema.files import together
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.part_sheet import ToolUse
from pipeline.schema.store import write_bytes, write_json
from pipeline.twin.cut.axes import half_widths
from pipeline.twin.preflight import Preflight, preflight_warnings

T = TypeVar("T")
TOTALS = (
    ("time", "s", "time_s", 1, "time_percent"),
    ("cost", None, "cost", 1, "cost_percent"),
    ("energy", "kWh", "energy_kWh", 1, "energy_percent"),
    ("tool life", "%", "tool_life_share", 100, "tool_life_percent"),
    ("peak load", "N", "peak_load_N", 1, None),
    ("beyond", "blocks", "beyond", 1, None),
)
"""Name, unit (the currency where None), key, factor, key of the change."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Search settings of the options; those that are None are as in conf/."""

    epsilon: float | None = None
    seed: int | None = None
    split: bool = False
    speeds: str | None = None
    proof_comment: bool = False
    with_residual: bool = False

    def settings(self, own: OptimisationSettings) -> OptimisationSettings:
        """The settings of conf/ with what the options change."""
        return replace(
            own,
            certainty=_with(own.certainty, epsilon=self.epsilon, seed=self.seed),
            search=_with(own.search, seed=self.seed),
            grouping=_with(own.grouping, speeds=self.speeds, split=self.split or None),
            proof_comment=self.proof_comment or own.proof_comment,
            with_residual=self.with_residual or own.with_residual,
        )


def _with(settings: T, **options: float | str | None) -> T:
    given = {name: value for name, value in options.items() if value is not None}
    return replace(settings, **given)  # type: ignore[type-var]


def optimised_document(on: Controlled, result: Result, checked: Preflight) -> OptimisedPart:
    """Document of an optimised program, with what the program as written violates."""
    part = optimised_part(result, machine=on.machine, origin=on.origin, control=on.source)
    return replace(
        part, machine_unit=on.unit or None,
        warnings=(*preflight_warnings(checked.violations), *part.warnings),
    )  # fmt: skip


@together()
def write_optimised(
    result: Result, part: OptimisedPart, made: Callable[[], Made], program: Path,
    json: Path | None, page: Path | None,
) -> None:  # fmt: skip
    """Write the program, and JSON and page where they are named."""
    write_bytes(optimised_text(result), program)
    if json is not None:
        write_json(part_values(part), json)
    if page is not None:
        write_optimised_page(part, page, json, made())


@contextmanager
def interruptible(said: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed, to end with the best so far; a second one ends at once."""
    asked = False

    def first(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        said()

    before = signal.signal(signal.SIGINT, first)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)


def optimise_lines(part: OptimisedPart) -> Iterator[str]:
    """Before and after, certainty, methods, what binds, what was changed, what is not known."""
    source = "identified" if part.control == "identified" else "as in conf, times unproven"
    yield (
        f"{part.program} on {part.machine}{label(part.origin)}, control {source}: "
        f"{part.objective}, {part.stock} in {part.material}"
    )
    if part.machine_unit is not None:
        yield f"  on unit {part.machine_unit}; --unit names another one"
    yield from warning_lines(part.warnings)
    yield from verdict_lines(part.verdicts)
    if part.residual is not None:
        yield f"  following errors with {part.residual}: {half_widths(part.verified.axes)} (90 %)"
    yield from edge_lines(part.edges)
    if part.interrupted:
        yield "interrupted: the best that was found until then"
    yield from _totals(part)
    yield from _passed_before(part)
    yield from _tools(part)
    yield from _certainty(part)
    yield from _methods(part)
    yield from _binding(part)
    yield from _changes(part)
    for held in part.held:
        yield f"  held: {held.reason}, {many(held.rows, 'move')}, the first in {held.first}"
    yield from warning_lines([one for one in part.setup.warnings if one not in part.warnings])
    yield from (f"  {note}" for note in part.notes if note.startswith("tool life of"))
    for unknown in part.not_known:
        yield f"  not known: {unknown.what}, {unknown.why}"


def _passed_before(part: OptimisedPart) -> Iterator[str]:
    """Limits that fewer blocks pass than did as programmed: what a slower answer is for."""
    passed = [
        f"{name} in {many(count, 'block')}"
        for name, count in part.before.beyond_of.items()
        if count > part.after.beyond_of.get(name, 0)
    ]
    if passed:
        yield f"  as programmed it passes its limits: {', '.join(passed)}"


def _totals(part: OptimisedPart) -> Iterator[str]:
    rows = [["", "", "before", "after", "change"]]
    for name, unit, key, factor, change in TOTALS:
        printed = part.currency if unit is None else unit
        values = [
            rounded(getattr(side, key), factor, 4)
            + between(getattr(side, f"{key}_low", None), getattr(side, f"{key}_high", None), factor)
            for side in (part.before, part.after)
        ]
        percent = _change(getattr(part.gain, change)) if change else NONE
        rows.append([name, printed or "", *values, percent])
    yield from (f"  {line}" for line in aligned(rows, words=2))


def _tools(part: OptimisedPart) -> Iterator[str]:
    rows = [
        ["tool", "", "f_z", "", "range", "v_c", "", "range", "bending", "", "binds"],
        ["", "", "mm", "after", "", "m/min", "after", "", "um", "after", ""],
    ]
    for use in part.tools:
        rows.append([
            f"T{use.tool}", " ".join(filter(None, (use.name, use.operation))),
            rounded(use.before.feed_per_tooth_mm), rounded(use.after.feed_per_tooth_mm),
            _range(use.feed_per_tooth_range_mm),
            rounded(use.before.cutting_speed_m_min), rounded(use.after.cutting_speed_m_min),
            _range(use.cutting_speed_range_m_min),
            *(_bending(side.deflection_um) for side in (use.before, use.after)),
            f"kept: {use.kept}" if use.kept else use.binds or "nothing",
        ])  # fmt: skip
    if part.tools:
        yield from (f"  {line}" for line in aligned(rows, words=2))
    yield from _not_raised("F", [(use, use.no_more_feed) for use in part.tools])
    yield from _not_raised("S", [(use, use.no_faster) for use in part.tools])


def _not_raised(letter: str, uses: list[tuple[ToolUse, str | None]]) -> Iterator[str]:
    alike: dict[str, list[str]] = {}
    for use, why in uses:
        if why:
            alike.setdefault(why, []).append(f"T{use.tool} {use.operation}".strip())
    for why, named in alike.items():
        yield f"  {letter} not raised: {', '.join(dict.fromkeys(named))}: {why}"


def _bending(value: float | None) -> str:
    """Deflection [um]; that of teeth in balance is what rounding leaves."""
    return rounded(value if value is None else round(value, 3))


def _range(known: tuple[float, float] | None) -> str:
    return NONE if known is None else f"{known[0]:.3g}..{known[1]:.3g}"


def _certainty(part: OptimisedPart) -> Iterator[str]:
    of = part.certainty
    if of is None:
        return
    low, high = (_percent(end) for end in of.interval_95)
    yield (
        f"  certainty: P(load > {of.limits_N}) = {_percent(of.exceedance)} ({low} to {high}), at "
        f"most {_percent(of.epsilon)} asked, {many(of.draws, 'draw')}{of.of_tools}"
    )
    price = of.price
    if price is not None:
        cost = "" if price.cost is None else (
            f", {rounded(price.cost)} {part.currency} ({_change(price.cost_percent)})"
        )  # fmt: skip
        yield (
            f"  its price: {rounded(price.time_s)} s ({_change(price.time_percent)}){cost} "
            "against the optimum that takes every value as known"
        )


def _methods(part: OptimisedPart) -> Iterator[str]:
    currency = part.currency or ""
    rows = [
        ["method", "limits", "", "time", "cost", "energy", "tool life", "evaluations"],
        ["", "", "", "s", currency, "kWh", "%", ""],
    ]
    rows += [
        [
            one.method,
            one.limits,
            "inside" if one.feasible else "beyond",
            rounded(one.time_s, 1, 4),
            rounded(one.cost, 1, 4),
            rounded(one.energy_kWh),
            rounded(one.tool_life_share, 100),
            str(one.evaluations),
        ]
        for one in part.methods
    ]
    yield from (f"  {line}" for line in aligned(rows, words=3))
    knee = next((k for k, one in enumerate(part.front, 1) if one.knee), None)
    if knee is not None:
        better = sum(one.no_worse for one in part.front)
        of = f"of the {better} no worse" if better else "of all, none being no worse"
        yield f"  front: {many(len(part.front), 'program')}; knee: number {knee}, {of} than before"


def _binding(part: OptimisedPart) -> Iterator[str]:
    for one in part.binding:
        held = f"{many(one.blocks, 'block')}, {rounded(one.time_s)} s"
        if one.kept:
            yield f"  {one.limit}: {one.kept}, {held}"
        else:
            yield f"  binds: {one.limit or 'nothing':<16} {held}"


def _why_not(part: OptimisedPart) -> Iterator[str]:
    for one in part.binding:
        why = one.kept or (f"{one.limit} binds" if one.limit else "nothing better was found")
        yield f"{why}, {many(one.blocks, 'block')}"


def _changes(part: OptimisedPart) -> Iterator[str]:
    words, proof = part.words, part.proof
    counts = (
        ("F changed", words.F_changed), ("F added", words.F_added),
        ("S changed", words.S_changed), ("S added", words.S_added),
    )  # fmt: skip
    parts = ", ".join(f"{count} {what}" for what, count in counts if count)
    yield f"  words: {parts}" if parts else f"  nothing to change: {'; '.join(_why_not(part))}"
    if part.split is not None:
        yield f"  split: {part.split}"
    if proof.same:
        yield (
            f"  proof: {many(proof.moves, 'move')} the same to the last bit, sha256 {proof.sha256}"
        )
    else:
        yield f"  proof: NOT the same, first difference {proof.first}"
    verified = part.verified
    if verified.peak_load_N is not None:
        where = "" if verified.peak_line is None else f" in line {verified.peak_line}"
        yield (
            f"  whole twin: peak load {rounded(verified.peak_load_N)} N{where}, "
            f"{many(verified.full_evaluations, 'evaluation')}, "
            f"{many(verified.tightened, 'round')} of tightening"
        )


def _change(value: float | None) -> str:
    return NONE if value is None else f"{value:+.1f} %"


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{100 * value:.2g} %"
