"""Path of an optimised program from above and from the front, coloured by load, with its blank.

A mark on it follows a slider where a script runs; without one the figures stand for themselves.
"""

import json

import numpy as np
from markupsafe import Markup, escape

from pipeline.charts import svg
from pipeline.charts.sections import Figure, Figures, Section
from pipeline.charts.sources import Source
from pipeline.report.programs import moves
from pipeline.schema.arrays import Floats
from pipeline.schema.part import LoadTrace, OptimisedPart
from pipeline.schema.part_sheet import PathTrace

(PLAN, _), (FRONT, _) = moves.VIEWS

SCRIPT = Markup("""
for (const control of document.querySelectorAll('.slider')) {
  const rows = JSON.parse(control.dataset.points), groups = JSON.parse(control.dataset.groups);
  const range = control.querySelector('[type=range]');
  const line = control.querySelector('[type=number]');
  const said = control.querySelector('output'), section = control.closest('section');
  const number = x => x === null ? '–' : String(+x.toPrecision(6));
  const change = (a, b) => a === b ? number(b) : number(a) + ' → ' + number(b);
  const show = k => {
    const [at, u, v, w, x, y, z, before, after] = rows[k];
    for (const mark of section.querySelectorAll('.mark')) {
      mark.setAttribute('cx', u + '%');
      mark.setAttribute('cy', (mark.classList.contains('plan') ? v : w) + '%');
    }
    const own = groups.find(g => g[0] <= at && at <= g[1]);
    said.textContent = 'Line ' + at + ': X ' + x + ' Y ' + y + ' Z ' + z + '; load '
      + (after === null ? 'none, in air' : change(before, after) + ' N')
      + (own ? '; F ' + change(own[2], own[3]) + ', S ' + change(own[4], own[5]) : '');
    if (document.activeElement !== line) line.value = at;
  };
  range.addEventListener('input', () => show(+range.value));
  line.addEventListener('input', () => {
    const k = rows.findIndex(row => row[0] >= +line.value);
    range.value = k < 0 ? rows.length - 1 : k;
    show(+range.value);
  });
  control.hidden = false;
  for (const mark of section.querySelectorAll('.mark')) mark.removeAttribute('hidden');
  show(+range.value);
}
""")
"""Moves the mark along the path; the page's policy names it by its hash."""


def load_classes(loads: Floats) -> moves.Classes:
    """Classes between round loads up to the greatest [N], NaN being air."""
    most = max(float(np.nanmax(loads)), 1e-6)
    marks = tuple(mark for mark in svg.ticks(0.0, most, most=moves.COLOURS) if 0 < mark < most)
    return moves.Classes(
        bounds=marks[: moves.COLOURS - 1], unit="N", alike="in the cut", unknown="in air"
    )


def path_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    """The path coloured by load before and after; None where there is none to draw."""
    path = part.path
    if path is None or not path.x_mm:
        return None
    loads = [_loads(path, trace) for trace in (part.trace.before, part.trace.after)]
    whole = np.concatenate(loads)
    if np.isnan(whole).all():
        return None
    classes, limit = load_classes(whole), part.load_limit_N or np.inf
    points = np.array([path.x_mm, path.y_mm, path.z_mm]).T
    ends = np.concatenate([points, _corners(path)])
    shown = moves.framed(ends.min(axis=0), ends.max(axis=0))
    figures = [
        Figure(
            svg=svg.group([
                moves.panel(
                    shown, axes,
                    _strokes(path, moves.grid_points(points, shown, axes, 1), load, classes, limit),
                    f"{view}: Path of {part.program} {words}",
                    behind=[_blank(path, shown, axes)], above=[_mark(axes)],
                )
                for axes, view in moves.VIEWS
            ]),
            caption=f"{words.capitalize()}: path at feed in {path.frame}, from above and from the "
            "front, coloured by the peak load across the tool’s axis; the blank behind it.",
            sources=sources,
        )
        for words, load in zip(("as programmed", "optimised"), loads, strict=True)
    ]  # fmt: skip
    legend = [classes.legend(k) for k in (*range(len(classes)), moves.UNKNOWN)]
    legend.append(("s-blank", "blank", "box"))
    if np.nanmax(whole) > limit:
        legend.append(("s-over", "above the limit", "box"))
    control = _control(part, path, shown, points, loads)
    return Section(key="path", title="Where the load is",
                   blocks=[Figures(figures=figures, legend=legend, control=control)])  # fmt: skip


def _loads(path: PathTrace, trace: LoadTrace) -> Floats:
    """Load on the path to each point [N], NaN in air; shape (V,)."""
    load = np.array(trace.load_N, dtype=np.float64)
    if not len(load):
        return np.full(len(path.column), np.nan)
    return load[np.minimum(np.array(path.column), len(load) - 1)]


def _strokes(
    path: PathTrace, at: np.ndarray, load: Floats, classes: moves.Classes, limit: float
) -> list[Markup]:
    """Pieces between points on the map's grid (V, 2) by load, air first and the greatest last."""
    over = load > limit
    kind = np.where(over, len(classes), classes.of(load))
    joined = np.ones(len(at), dtype=bool)
    joined[list(path.starts)] = False
    drawn = []
    for index in (moves.UNKNOWN, *range(len(classes) + 1)):
        name = "over" if index == len(classes) else classes.colour(index)
        rows = np.flatnonzero(joined & (kind == index))
        if data := moves.stroke(at[rows - 1], at[rows]):
            drawn.append(svg.tag("path", d=data, class_=f"curve load {name}"))
    return drawn


def _mark(axes: moves.Axes) -> Markup:
    kind = "plan" if axes == PLAN else "front"
    return svg.tag("circle", r=6, cx="0%", cy="0%", class_=f"mark {kind}", hidden="hidden")


def _percent(shown: moves.View, axes: moves.Axes, points: Floats) -> Floats:
    """Place of points (N, 3) in a view [%], across and down; shape (N, 2)."""
    u, v = axes
    across = (points[:, u] - shown.low[u]) / shown.span[u]
    down = 1 - (points[:, v] - shown.low[v]) / shown.span[v]
    return 100 * np.stack([across, down], axis=1)


def _corners(path: PathTrace) -> Floats:
    """Two opposite corners of the blank [mm]; shape (2, 3)."""
    return np.array([path.blank_low_mm, path.blank_high_mm])


def _blank(path: PathTrace, shown: moves.View, axes: moves.Axes) -> Markup:
    (left, bottom), (right, top) = _percent(shown, axes, _corners(path)).tolist()
    if path.round_blank and axes == PLAN:
        return svg.tag(
            "ellipse", cx=f"{(left + right) / 2:.2f}%", cy=f"{(top + bottom) / 2:.2f}%",
            rx=f"{(right - left) / 2:.2f}%", ry=f"{(bottom - top) / 2:.2f}%", class_="s-blank",
        )  # fmt: skip
    return svg.tag(
        "rect", x=f"{left:.2f}%", y=f"{top:.2f}%", width=f"{right - left:.2f}%",
        height=f"{bottom - top:.2f}%", class_="s-blank",
    )  # fmt: skip


def _control(
    part: OptimisedPart, path: PathTrace, shown: moves.View, points: Floats, loads: list[Floats]
) -> Markup:
    """Slider and field for the line, with what the script reads; hidden until it runs."""
    plan, front = (_percent(shown, axes, points) for axes in (PLAN, FRONT))
    before, after = (
        [None if np.isnan(value) else float(f"{value:.4g}") for value in load.tolist()]
        for load in loads
    )
    rows = [
        [line, *place, *at, then, now]
        for line, place, at, then, now in zip(
            path.line, np.column_stack([plan, front[:, 1]]).round(2).tolist(),
            points.round(2).tolist(), before, after, strict=True,
        )
    ]  # fmt: skip
    groups = [
        [row.first_line, row.last_line, row.feed_before, row.feed_after, row.speed_before,
         row.speed_after]
        for row in part.groups
    ]  # fmt: skip
    data = [escape(json.dumps(values, separators=(",", ":"))) for values in (rows, groups)]
    return Markup(
        '<div class="slider" hidden data-points="{}" data-groups="{}">'
        '<label>Line <input type="number" min="{}" max="{}" value="{}"></label>'
        '<input type="range" min="0" max="{}" value="0" aria-label="Place along the path">'
        "<output></output></div>"
    ).format(*data, min(path.line), max(path.line), path.line[0], len(rows) - 1)
