"""Documents of an optimisation, and of the cut of a program as written."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from pipeline.machine.control.path import where
from pipeline.optimisation import part_sheet as sheet
from pipeline.optimisation.comparison import (
    BINDS,
    KEPT,
    RowReasons,
    Side,
    alike_runs,
    exceeded_limits,
    load_trace,
    tool_spans,
)
from pipeline.optimisation.full_twin import NOTHING, Result, check_axes
from pipeline.optimisation.job import Job
from pipeline.optimisation.methods.genes import Method
from pipeline.optimisation.proof.prove import with_proof_comment
from pipeline.optimisation.reliability.part_loads import cut_ranges, force_intervals
from pipeline.optimisation.reliability.uncertainty import uncertainty, used_models
from pipeline.optimisation.settings import Part
from pipeline.optimisation.text.editable_blocks import reads_feed
from pipeline.optimisation.text.words import FeedWords
from pipeline.schema import part as stored
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.files import together
from pipeline.schema.limits import by_tool_words
from pipeline.schema.part import OptimisedPart, Totals, part_values
from pipeline.schema.program_cut import (
    AS_WRITTEN,
    CutProgram,
    CutWarning,
    NotKnown,
    ProgramCut,
)
from pipeline.schema.store import write_bytes, write_json
from pipeline.twin.cut.axes import half_widths
from pipeline.twin.cut.coefficients import changed_earlier, tool_edges
from pipeline.twin.cut.document import (
    assessed,
    document_of,
    life_sources,
    not_known,
    notes,
    warnings_of,
)
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import figure, summary
from pipeline.twin.cut.warnings import setup_warnings
from pipeline.twin.preflight import (
    Preflight,
    limits_of,
    preflight,
    preflight_warnings,
    violation_lines,
)
from pipeline.twin.simulation import program_times, write_block_table

AXES = "following error and motor command in the cut"
"""Quantities that are not known without drives."""
DIGITS = 4
"""Digits of a metric."""

RUBS = 0.9
"""Share of the least feed for each tooth below which less is no rounding of F [1]."""


def optimised_text(result: Result) -> bytes:
    """The program to write: with the proof in a comment at its end where the settings say so."""
    text = result.answer.text
    return with_proof_comment(text, result.proof) if result.job.settings.proof_comment else text


def optimised_part(result: Result, *, machine: str, origin: str, control: str) -> OptimisedPart:
    """Stored document of an optimisation.

    ``origin``: ``simulated`` or ``recorded``; ``control``: ``identified`` or ``conf/machine``.
    """
    job, basis = result.job, result.job.basis
    before, after = _sides(result)
    totals = _totals(before, result), _totals(after, result)
    reasons = RowReasons(result)
    words = FeedWords(reasons.program, result.moves)
    warnings, odd = warnings_of(after.of, basis), setup_warnings(after.cut, basis.table)
    return OptimisedPart(
        warnings=(
            *_given_up(result),
            *changed_earlier(basis.wear),
            *_chatters(result),
            *_rubs(result),
            *(one for one in warnings if one.grave or one in odd),
        ),
        verdicts=used_models(job.models.verdicts, job.settings.certainty),
        program=job.program.name.rpartition("/")[2],
        machine=machine,
        origin=origin,
        control=control,
        objective=job.objective,
        currency=None if basis.rates is None else basis.rates.currency,
        stock=basis.stock,
        material=basis.material.name,
        tool_table=basis.table,
        limits=job.limits,
        certainty=_reliability(result),
        before=totals[0],
        after=totals[1],
        gain=_gain(*totals),
        methods=tuple(_method(one) for one in result.methods),
        front=_front(result),
        groups=_groups(result, before, after, reasons, words),
        binding=_binding(result, after, reasons),
        held=result.problem.editable.held,
        words=_words(result),
        proof=_proof(result),
        trace=stored.Traces(
            before=load_trace(before.cut), after=load_trace(after.cut), tools=tool_spans(before.cut)
        ),
        verified=_verified(result),
        interrupted=result.interrupted,
        not_known=_not_known(result, after),
        notes=(
            *_with_residual(result),
            *_given_way(result),
            *notes(after.of, basis),
            *("{}: {} ({})".format(*life) for life in life_sources(after.cut, basis.material)),
        ),
        tools=sheet.tool_uses(result, before, after, reasons),
        changes=sheet.feed_changes(result, before, after, reasons, words),
        lines=sheet.program_lines(result, before, after, words),
        path=sheet.path_trace(before.cut, job.cut.stock),
        setup=sheet.setup_sheet(result, after.of, warnings),
        unit=words.program_unit(reads_feed(result.moves)),
        residual=None if job.models.residual is None else job.models.residual_name,
        edges=tool_edges(after.cut, after.of.arcs, basis.coefficients),
        split=result.split,
    )


def _given_up(result: Result) -> Iterator[CutWarning]:
    """One for each tool that cannot keep its limits: its blocks stay as programmed."""
    for number, why in result.given_up.items():
        rows = np.flatnonzero(result.problem.cuts & (result.moves.tool == number))
        sure = "" if result.risk is None else ", the certainty is that of the other tools"
        yield CutWarning(
            what=f"T{number} cannot keep its limits and stays as programmed{sure}: {why}",
            do="Give it a limit that it can keep, or less depth.",
            lines=tuple(dict.fromkeys(result.moves.line[rows].tolist())),
            blocks=len(rows), grave=True,
        )  # fmt: skip


def _chatters(result: Result) -> Iterator[CutWarning]:
    """Warning for each tool that misses the margin of stability at any S as programmed."""
    problem = result.problem
    limit, least = problem.limits.margins.stability, problem.least_margin
    for number in np.unique(problem.cut.tool[least < limit]).tolist():
        rows = np.flatnonzero((least < limit) & (problem.cut.tool == number))
        worst = int(rows[np.argmin(least[rows])])
        margin = 100 * float(least[worst])
        near = (
            f"chatter is predicted from {100 + margin:.0f} % of the depth on" if margin < 0
            else f"the depth is {margin:.0f} % below that of chatter"
        )  # fmt: skip
        yield CutWarning(
            what=f"T{problem.cut.numbers[number]} in the program as it is: {near}, worst in "
            f"{where(result.moves, worst)}, and no S that it may have keeps the margin of "
            f"{100 * limit:.0f} %: there its F and S rise no further",
            do="Listen, or measure the dynamics of the tip.",
            lines=tuple(dict.fromkeys(result.moves.line[np.sort(rows)].tolist())),
            blocks=len(rows),
        )


def _rubs(result: Result) -> Iterator[CutWarning]:
    """One for each tool whose limits leave less feed for each tooth than its range begins with."""
    practice, cut = result.problem.practice, result.problem.cut
    if practice is None:
        return
    now = result.answer.cut.commanded_feed_per_tooth()[result.answer.rows]
    low = result.problem.cuts & (now < RUBS * practice.f_z_low)
    for number in np.unique(cut.tool[low]).tolist():
        rows = np.flatnonzero(low & (cut.tool == number))
        worst = int(rows[np.argmin(now[rows] / practice.f_z_low[rows])])
        yield CutWarning(
            what=f"T{cut.numbers[number]} keeps its limits only at {now[worst] * 1e3:.2g} mm a "
            f"tooth, as in {where(result.moves, worst)}, below its range and below the program: it "
            "rubs rather than cuts",
            do="Take less depth, or a tool that bears more.",
            lines=tuple(dict.fromkeys(result.moves.line[rows].tolist())), blocks=len(rows),
        )  # fmt: skip


def _with_residual(result: Result) -> Iterator[str]:
    """A sentence where following errors hold what a residual network adds to them."""
    models, axes = result.job.models, result.answer.verified.axes.axes
    if models.residual is not None:
        yield (
            f"following errors are those of the drives with {models.residual_name}, and a limit on "
            f"them holds against the error and half of its 90 % interval: {half_widths(axes)}"
        )


def _given_way(result: Result) -> Iterator[str]:
    """A sentence where the least F of the limits gives way to the greatest change."""
    problem, given = result.problem, result.problem.limits.feed_mm_min
    if problem.practice is None or given is None:
        return
    most = problem.practice.feed_high
    rows = np.flatnonzero(problem.cuts & (problem.editable.block >= 0) & (most < given[0]))
    if len(rows):
        row = int(rows[np.argmin(most[rows])])
        yield (
            f"{where(result.moves, row)}: F stays below the {given[0]:g} mm/min that "
            f"limits.feed_mm_min asks for, at {most[row]:.4g} at most, as in {len(rows) - 1} other "
            "moves: it may not change by more than practice.change allows; widen one of the two"
        )


def _sides(result: Result) -> tuple[Side, Side]:
    """Program as programmed and as optimised, with time and cost of every row of the first."""
    basis, answer = result.job.basis, result.answer
    before, after = assessed(result.before, basis), assessed(answer.cut, basis)
    own = np.arange(len(result.moves))
    return (Side.of_rows(result.before, before, own), Side.of_rows(answer.cut, after, answer.rows))


def _totals(side: Side, result: Result) -> Totals:
    sums = summary(side.of.results)
    passed = exceeded_limits(side.of, result.job.limits)
    alike = {one.name for one in fields(Totals)} & {one.name for one in fields(sums)} - {"cost"}
    return Totals(
        **{name: getattr(sums, name) for name in alike},
        **{f"cost{end}": getattr(sums.cost, f"sum{end}", None) for end in ("", "_low", "_high")},
        beyond=int(np.logical_or.reduce([*passed.values()]).sum()),
        beyond_of={name: int(of.sum()) for name, of in passed.items() if of.any()},
    )


def _gain(before: Totals, after: Totals) -> stored.Gain:
    names = {"time": "time_s", "cost": "cost", "energy": "energy_kWh",
             "tool_life": "tool_life_share"}  # fmt: skip
    return stored.Gain(**{
        f"{name}_percent": _change(getattr(before, key), getattr(after, key))
        for name, key in names.items()
    })  # fmt: skip


def _change(before: float | None, after: float | None) -> float | None:
    if before is None or after is None or before <= 0:
        return None
    return figure(100 * (after / before - 1), 4)


def _method(method: Method) -> stored.MethodResult:
    return stored.MethodResult(
        method=method.name, limits=method.limits, feasible=method.kept,
        evaluations=method.evaluations, **_figures(method.objectives),
    )  # fmt: skip


def _figures(objectives: Floats) -> dict[str, float | None]:
    names = ("time_s", "cost", "energy_kWh", "tool_life_share")
    return dict(zip(names, map(figure, objectives.tolist()), strict=True))


def _front(result: Result) -> tuple[stored.FrontMember, ...]:
    front = result.front
    if front is None:
        return ()
    return tuple(
        stored.FrontMember(knee=k == front.knee, no_worse=bool(better), **_figures(values))
        for k, (values, better) in enumerate(zip(front.objectives, front.no_worse, strict=True))
    )


def _reliability(result: Result) -> stored.Reliability | None:
    risk, settings = result.risk, result.job.settings.certainty
    if risk is None or result.uncertain is None:
        return None
    nominal, price = _price(result)
    used = np.unique(result.moves.tool[result.problem.cuts]).tolist()
    tools = {number: result.job.cut.tools[number] for number in used}
    outside = [n for n, tool in tools.items() if n in result.given_up or not tool.load_known]
    own = {n: tool.limit_load_N for n, tool in tools.items() if n not in outside}
    low, high = risk.interval_95
    return stored.Reliability(
        epsilon=settings.epsilon,
        exceedance=figure(risk.probability),
        interval_95=(figure(low), figure(high)),
        draws=risk.draws,
        peaks=tuple(
            stored.PeakQuantile(share=float(share), load_N=figure(load))
            for share, load in sorted(risk.peak_quantiles.items())
        ),
        nominal=nominal,
        price=price,
        uncertain=result.uncertain.quantities,
        limits_N=by_tool_words(result.job.limits.load_N, own, "N"),
        without=tuple(outside),
    )


def _price(result: Result) -> tuple[stored.Nominal | None, stored.Price | None]:
    """Price of reliability: the blockwise optimum with it beside that at nominal values."""
    if result.nominal is None:
        return None, None
    rows = {(one.method, one.limits): one for one in map(_method, result.methods)}
    nominal = rows[result.nominal, "nominal"]
    sure = rows[result.nominal, "certain"]
    price = stored.Price(
        time_s=_extra(nominal.time_s, sure.time_s),
        time_percent=_change(nominal.time_s, sure.time_s),
        cost=_extra(nominal.cost, sure.cost),
        cost_percent=_change(nominal.cost, sure.cost),
    )
    return stored.Nominal(time_s=nominal.time_s, cost=nominal.cost), price


def _extra(before: float | None, after: float | None) -> float | None:
    return None if before is None or after is None else figure(after - before)


def _groups(
    result: Result, before: Side, after: Side, reasons: RowReasons, words: FeedWords
) -> tuple[stored.BlockGroup, ...]:
    """Each run of blocks of one F and one S, in the order of the program."""
    moves, cuts = result.moves, result.problem.cuts
    feeds = words.written(before.feed), words.written(after.feed)
    free = cuts & ~reasons.kept
    return tuple(
        stored.BlockGroup(
            first_line=int(moves.line[rows].min()),
            last_line=int(moves.line[rows].max()),
            tool=int(moves.tool[rows[0]]),
            feed_before=_mean(feeds[0], before.time, rows),
            feed_after=_mean(feeds[1], after.time, rows),
            feed_unit=words.unit(rows[0]),
            speed_before=_mean(before.speed, before.time, rows),
            speed_after=_mean(after.speed, after.time, rows),
            time_before_s=figure(float(before.time[rows].sum())),
            time_after_s=figure(float(after.time[rows].sum())),
            cost_before=figure(float(before.cost[rows].sum())),
            cost_after=figure(float(after.cost[rows].sum())),
            peak_load_before_N=_load(before.peak[rows]),
            peak_load_after_N=_load(after.peak[rows]),
            binds=sheet.longest_binding(reasons.binds, after.time, rows[free[rows]]),
            kept=reasons.why_both(rows[cuts[rows]]),
        )
        for rows in _runs(result, words)
    )


def _load(peaks: Floats) -> float | None:
    """Greatest load of rows [N]; that of teeth in balance is what rounding leaves."""
    greatest = float(peaks.max())
    return figure(greatest if greatest > NOTHING else 0.0)


def _runs(result: Result, words: FeedWords) -> list[Rows]:
    """Rows of each group; a row that neither cuts nor has an F to change is in none."""
    groups, moves = result.answer.decision.groups, result.moves
    rows = np.flatnonzero((groups.feed >= 0) | result.problem.cuts)
    return alike_runs(rows, groups.feed, groups.speed, moves.tool, moves.file, words.code)


def _mean(values: Floats, seconds: Floats, rows: Rows) -> float | None:
    """Mean over rows weighted by their time; plain mean where they take none."""
    weights = seconds[rows] if seconds[rows].sum() > 0 else np.ones(len(rows))
    if np.ptp(values[rows]) == 0:
        return figure(float(values[rows[0]]))
    return figure(float(values[rows] @ weights / weights.sum()))


def _binding(result: Result, after: Side, reasons: RowReasons) -> tuple[stored.Binding, ...]:
    """Limits that bind, with the blocks that cut and their time; the longest first."""
    binds, cuts = reasons.binds, result.problem.cuts
    rows = []
    for k in np.unique(binds[cuts]).tolist():
        mine, limit = np.flatnonzero(cuts & (binds == k)), BINDS[k] if k >= 0 else None
        alike = reasons.kept_by_reason(mine) if limit == KEPT else [(None, mine)]
        for why, some in alike:
            rows.append(stored.Binding(
                limit=limit, blocks=len(some), time_s=figure(float(after.time[some].sum())),
                kept=why or None,
            ))  # fmt: skip
    return tuple(sorted(rows, key=lambda row: -(row.time_s or 0.0)))


def _words(result: Result) -> stored.WordCounts:
    counts = Counter((change.letter, change.before is None) for change in result.answer.changes)
    return stored.WordCounts(
        F_changed=counts["F", False], F_added=counts["F", True],
        S_changed=counts["S", False], S_added=counts["S", True],
    )  # fmt: skip


def _proof(result: Result) -> stored.StoredProof:
    proof = result.proof
    return stored.StoredProof(
        same=proof.same,
        sha256=proof.sha256,
        moves=proof.moves,
        before_sha256=sha256(result.job.program.data).hexdigest(),
        after_sha256=sha256(optimised_text(result)).hexdigest(),
        first=None if proof.first is None else str(proof.first),
        points=proof.points,
    )


def _verified(result: Result) -> stored.TwinCheck:
    verified, moves = result.answer.verified, result.answer.cut.plan.path.moves
    worst, lags = verified.peak_row, verified.following_um
    return stored.TwinCheck(
        peak_load_N=figure(verified.peak_N) if worst >= 0 else None,
        peak_line=int(moves.line[worst]) if worst >= 0 else None,
        following_um={axis: figure(um) for axis, um in lags.items()} if lags else None,
        full_evaluations=result.evaluated,
        tightened=result.tightened,
        axes=verified.axes.axes,
    )


def _not_known(result: Result, after: Side) -> tuple[NotKnown, ...]:
    rows = not_known(after.of, result.job.basis)
    return (*rows, *_axes_not_known(result.answer.verified.axes.reason))


def _axes_not_known(why: str) -> tuple[NotKnown, ...]:
    return (NotKnown(what=AXES, why=why),) if why else ()


def cut_document(cut: Cut, job: Job, checked: Preflight) -> ProgramCut:
    """The cut of a program as ``kerf simulate`` and the stage store it, by the models of ``job``.

    ``checked``: the program against travel, speeds, feeds and tool lengths.
    """
    models, coefficients, certainty = job.models, job.basis.coefficients, job.settings.certainty
    document = document_of(cut, job.basis)
    axes = check_axes(cut, models.drives, residual=models.residual)
    ranges = cut_ranges(cut)
    used = {number: coefficients[number] for number in ranges}
    uncertain = uncertainty(
        used, job.cut.tools, models.cutting, models.judged, certainty, ranges=ranges
    )
    return replace(
        document, axes=axes.axes,
        forces=force_intervals(cut, uncertain, coefficients, models.cutting, certainty.seed),
        not_known=(*document.not_known, *_axes_not_known(axes.reason)),
        warnings=(*preflight_warnings(checked.violations), *document.warnings),
    )  # fmt: skip


def write_program(label: str, before: bytes, after: bytes, part: OptimisedPart, out: Path) -> None:
    """Write ``<label>.before.nc``, ``<label>.nc`` and ``<label>.json`` into the folder ``out``."""
    with together():
        write_bytes(before, out / f"{label}.before.nc")
        write_bytes(after, out / f"{label}.nc")
        write_json(part_values(part), out / f"{label}.json")


def write_as_written(of: Part, result: Result, part: OptimisedPart, out: Path) -> None:
    """Write times and cut of the program as written, and the table of its moves.

    They are ``<label>.json`` and ``<label>.parquet`` in the folder ``as_written`` of ``out``.
    """
    job, cut = result.job, result.written
    drive, moves = job.basis.drive, cut.plan.path.moves
    limits = limits_of(job.setup, top_speed_rpm=None if drive is None else drive.top_speed_rpm)
    checked = preflight(moves, job.setup, limits)
    times = replace(
        program_times(cut.plan, of.label), machine=part.machine, origin=part.origin,
        file=of.program, sha256=part.proof.before_sha256, blocks=len(moves),
        violations=tuple(violation_lines(checked.violations)),
    )  # fmt: skip
    document, folder = cut_document(cut, job, checked), out / AS_WRITTEN
    with together():
        write_json(CutProgram(time=times, cut=document), folder / f"{of.label}.json")
        write_block_table(cut.plan, folder / f"{of.label}.parquet")


def part_metrics(parts: Mapping[str, OptimisedPart]) -> dict[str, float | int | bool]:
    """Metrics of parts by label, flat, the unit in the name; unknown ones are left out."""
    metrics: dict[str, float | int | bool] = {}
    for label, part in parts.items():
        currency = part.currency or "currency"
        values = {}
        for when, totals in (("before", part.before), ("after", part.after)):
            values[f"{when}_time_s"] = totals.time_s
            values[f"{when}_cost_{currency}"] = totals.cost
            values[f"{when}_peak_load_N"] = totals.peak_load_N
        values["exceedance"] = None if part.certainty is None else part.certainty.exceedance
        metrics |= {
            f"{label}_{name}": float(f"{value:.{DIGITS}g}")
            for name, value in values.items()
            if value is not None
        }
        metrics[f"{label}_same_geometry"] = part.proof.same
    return metrics
