"""Path of an optimised program from above and from the front, coloured by load, with its blank.

A mark on it follows a slider where a script runs; without one the figures stand for themselves.
"""

import json
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from markupsafe import Markup, escape

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.charts.sections import Figure, Figures, Section
from pipeline.charts.sources import Source
from pipeline.report.programs.map import HIGHEST, UNITS, View, framed, grid, grid_points, stroke
from pipeline.schema.arrays import Floats
from pipeline.schema.part import LoadTrace, OptimisedPart
from pipeline.schema.part_sheet import PathTrace

PLAN, FRONT = (0, 1), (0, 2)
COLOURS = 6  # of the scale in style.css, f0 to f5
CLASSES = 6  # of load, at most

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


@dataclass(frozen=True, kw_only=True)
class LoadClasses:
    """Classes of load between ``bounds`` [N], ascending; what is above ``limit`` stands out."""

    bounds: tuple[float, ...]
    limit: float | None
    exceeded: bool

    @classmethod
    def of(cls, loads: Floats, limit: float | None) -> "LoadClasses":
        """Round bounds up to the greatest load, NaN being air."""
        most = max(float(np.nanmax(loads)), 1e-6)
        marks = tuple(mark for mark in svg.ticks(0.0, most, most=CLASSES) if 0 < mark < most)
        exceeded = limit is not None and most > limit
        return cls(bounds=marks[: CLASSES - 1], limit=limit, exceeded=exceeded)

    def strokes(self, load: Floats) -> list[tuple[str, np.ndarray]]:
        """CSS class and which places (N,) have it, air first and the greatest last."""
        index = np.searchsorted(np.array(self.bounds), load, side="right")
        over = load > self.limit if self.limit is not None else np.zeros(len(load), dtype=bool)
        air = np.isnan(load)
        kinds = [("f-none", air)]
        kinds += [(self.colour(k), (index == k) & ~over & ~air)
                  for k in range(len(self.bounds) + 1)]  # fmt: skip
        return [*kinds, ("over", over)]

    def colour(self, index: int) -> str:
        """CSS name of a class's colour."""
        return f"f{round(index * (COLOURS - 1) / max(1, len(self.bounds)))}"

    def legend(self) -> list[tuple[str, str, str]]:
        """What each class holds."""
        ends = [number(round(bound) if bound >= 1 else bound) for bound in self.bounds]
        words = [f"{a} to {b}" for a, b in pairwise(ends)]
        words = [f"below {ends[0]} N", *words, f"{ends[-1]} N and more"] if ends else ["in the cut"]
        found = [(f"s-{self.colour(k)}", said, "box") for k, said in enumerate(words)]
        found += [("s-f-none", "in air", "box"), ("s-blank", "blank", "box")]
        return found + ([("s-over", "above the limit", "box")] if self.exceeded else [])


def path_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    """The path coloured by load before and after; None where there is none to draw."""
    path = part.path
    if path is None or not path.x_mm:
        return None
    loads = [_loads(path, trace) for trace in (part.trace.before, part.trace.after)]
    if np.isnan(np.concatenate(loads)).all():
        return None
    classes = LoadClasses.of(np.concatenate(loads), part.load_limit_N)
    points = np.array([path.x_mm, path.y_mm, path.z_mm]).T
    corners = np.array([path.blank_low_mm, path.blank_high_mm])
    ends = np.concatenate([points, corners])
    shown = framed(ends.min(axis=0), ends.max(axis=0))
    figures = [
        Figure(
            svg=_map(path, points, load, classes, shown, f"Path of {part.program} {words}"),
            caption=f"{words.capitalize()}: path at feed in {path.frame}, from above and from the "
            "front, coloured by the peak load across the tool’s axis; the blank behind it.",
            sources=sources,
        )
        for words, load in zip(("as programmed", "optimised"), loads, strict=True)
    ]
    control = _control(part, path, shown, points, loads)
    return Section(
        key="path", title="Where the load is",
        blocks=[Figures(figures=figures, legend=classes.legend(), control=control)],
    )  # fmt: skip


def _loads(path: PathTrace, trace: LoadTrace) -> Floats:
    """Load on the way to each point [N], NaN in air; shape (V,)."""
    load = np.array(trace.load_N, dtype=np.float64)
    if not len(load):
        return np.full(len(path.column), np.nan)
    drawn: Floats = load[np.minimum(np.array(path.column), len(load) - 1)]
    return drawn


def _map(
    path: PathTrace, points: Floats, load: Floats, classes: LoadClasses, shown: View, label: str
) -> Markup:
    widest = HIGHEST * float(shown.span[0] / shown.span[1])
    joined = np.ones(len(points), dtype=bool)
    joined[list(path.starts)] = False
    way = np.flatnonzero(joined)
    panels = []
    for axes, words in ((PLAN, "From above"), (FRONT, "From the front")):
        at = grid_points(points, shown, axes, 1)
        drawn = []
        for name, here in classes.strokes(load):
            rows = way[here[way]]
            if data := stroke(at[rows - 1], at[rows]):
                drawn.append(svg.tag("path", d=data, class_=f"curve load {name}"))
        wide, high = shown.span[list(axes)]
        inside = svg.tag(
            "svg", svg.group(drawn), x=0, y=0, width="100%", height="100%",
            viewBox=f"0 0 {UNITS} {round(UNITS * high / wide)}",
        )  # fmt: skip
        names = "XYZ"[axes[0]], "XYZ"[axes[1]]
        head = svg.text(0, -7, f"{words}: {names[1]} over {names[0]}, mm", "head")
        mark = svg.tag(
            "circle", r=6, cx="0%", cy="0%", class_=f"mark {'plan' if axes == PLAN else 'front'}",
            hidden="hidden",
        )  # fmt: skip
        parts = [_blank(path, shown, axes), *grid(shown, axes), inside, head, mark]
        panels.append(
            svg.map_plot(parts, wide=float(wide / high), most=widest, label=f"{words}: {label}")
        )
    return svg.group(panels)


def _percent(shown: View, axes: tuple[int, int], points: Floats) -> Floats:
    """Place of points (N, 3) in a view [%], across and down; shape (N, 2)."""
    u, v = axes
    across = (points[:, u] - shown.low[u]) / shown.span[u]
    down = 1 - (points[:, v] - shown.low[v]) / shown.span[v]
    place: Floats = 100 * np.stack([across, down], axis=1)
    return place


def _blank(path: PathTrace, shown: View, axes: tuple[int, int]) -> Markup:
    """Outline of the blank."""
    corners = np.array([path.blank_low_mm, path.blank_high_mm])
    (left, bottom), (right, top) = _percent(shown, axes, corners).tolist()
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
    part: OptimisedPart, path: PathTrace, shown: View, points: Floats, loads: list[Floats]
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
        [one.first_line, one.last_line, one.feed_before, one.feed_after, one.speed_before,
         one.speed_after]
        for one in part.groups
    ]  # fmt: skip
    data = [escape(json.dumps(values, separators=(",", ":"))) for values in (rows, groups)]
    return Markup(
        '<div class="slider" hidden data-points="{}" data-groups="{}">'
        '<label>Line <input type="number" min="{}" max="{}" value="{}"></label>'
        '<input type="range" min="0" max="{}" value="0" aria-label="Place along the path">'
        "<output></output></div>"
    ).format(*data, min(path.line), max(path.line), path.line[0], len(rows) - 1)
