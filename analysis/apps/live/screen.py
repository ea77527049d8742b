"""Layout of the screen: draws the view and the controls onto a canvas with the size of the terminal."""

from __future__ import annotations

from analysis.apps.live.canvas import Area, Canvas
from analysis.apps.live.controls import LiveControls
from analysis.apps.live.error_panels import draw_circle, draw_straight, draw_trace
from analysis.apps.live.figures import angle_deg, angle_name, plain_line, shown_curves
from analysis.apps.live.gauge_panels import draw_angle, draw_gauge, draw_lap, gauge_rows, scale_for
from analysis.apps.live.text_panels import draw_events, draw_foot, draw_head, draw_help, draw_joints, draw_links
from analysis.apps.live.view import LiveView

_LEAST_WIDTH, _LEAST_HEIGHT = 60, 18
"""Minimum size of the terminal for panels. A smaller one shows only figures."""
_THREE_WIDE = 150
"""Minimum width for large figures of the angle next to the gauges."""
_STRAIGHT = 170
"""Minimum width for the straight error curve."""


def screen(view: LiveView, controls: LiveControls, width: int, height: int) -> Canvas:
    canvas = Canvas(max(1, width), max(1, height))
    area = canvas.area()
    if width < _LEAST_WIDTH or height < _LEAST_HEIGHT:
        rows = [part.strip() for part in plain_line(view, controls.units, controls.zero_mm).split(";")]
        for row, words in enumerate(rows[: area.height]):
            area.put(row, 0, words)
        if area.height > len(rows):
            draw_foot(area.part(len(rows), 0, area.width, area.height - len(rows)), view, controls)
    else:
        figures = 3 if area.width >= _THREE_WIDE else 2
        most = 1 if area.height < 30 else 4
        scale = min(most, scale_for(view, controls, area.width // figures))
        links = 1 + len(view.state["streams"]) if view.state else 0 if view.played else 4
        links = min(links, max(4, area.height // 6))
        fixed = 1 + gauge_rows(scale) + links + 1
        trace = max(3, (area.height - fixed) // 4)
        heights = (1, gauge_rows(scale), area.height - fixed - trace, trace, links, 1)
        head, gauges, middle, below, foot, _ = area.rows(*heights)
        draw_head(head, view)
        parts = gauges.columns(*[area.width // figures] * figures)
        for k in range(2):
            draw_gauge(parts[k], view, controls, k, scale)
        if figures == 3:
            draw_angle(parts[2], view, controls, scale)
        _middle(middle, view, controls, with_angle=figures == 2)
        draw_trace(below, view, controls)
        draw_links(foot, view)
        if view.lost:  # show the last known state
            area.part(1, 0, area.width, area.height - 2).dim()
        draw_foot(area, view, controls)
    if controls.shows_help:
        draw_help(area)
    return canvas


def _middle(area: Area, view: LiveView, controls: LiveControls, *, with_angle: bool) -> None:
    curves = shown_curves(view)
    side = min(2 * area.height + 2, area.width // 2)
    circle, right = area.columns(side, area.width - side)
    draw_circle(circle, view, controls, curves)
    top = 0
    if with_angle and right.height >= 14:
        draw_angle(right.part(0, 0, right.width, gauge_rows(1)), view, controls, 1)
        top = gauge_rows(1) + 1
    elif with_angle:
        degrees = angle_deg(view, controls.zero_mm)
        right.put(0, 1, f"{angle_name(view)} {degrees:z.4f}°" if degrees is not None else "", "bold")
        draw_lap(right.part(1, 0, right.width, 1), view)
        top = 2
    else:
        top = 1
    below = right.part(top, 0, right.width, right.height - top)
    straight = area.width >= _STRAIGHT
    joints, others = below.rows(7, below.height - 7)
    if straight:
        column, plot = below.columns(min(66, below.width // 2), below.width - min(66, below.width // 2))
        joints, others = column.rows(7, column.height - 7)
        draw_straight(plot, view, controls, curves)
    draw_joints(joints, view)
    draw_events(others, view)
