"""Charts for paper: as SVG in the page, for printing and for browsers without scripts, and as part of a PNG.

Text stays text, in any font of the reader. Formula parsing is off, because names may contain two dollar signs.
"""

from __future__ import annotations

import io
import re
import textwrap
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, BinaryIO

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.projections.polar import PolarAxes
from matplotlib.text import Text

from analysis.apps.report.chart import ROLE_STYLES, Chart, ChartLine, Frame, Picture, SphereChart
from rigs.text import plain_lines

mpl.rcParams["text.parse_math"] = False


def as_png(draw: Callable[[], Figure], dpi: int = 150) -> Callable[[BinaryIO], None]:
    """Draw a picture only when it is written: hundreds of figures would not fit into memory."""
    return lambda file: draw().savefig(file, format="png", dpi=dpi)


Part = tuple[float, Callable[[SubFigure], None]]
"""Height in inches, and drawing function."""


class Sheet(Figure):
    """Constrained layout; characters missing in the font become boxes without a warning."""

    def __init__(self, width_inch: float, height_inch: float) -> None:
        super().__init__(figsize=(width_inch, height_inch), layout="constrained")

    def draw(self, renderer: RendererBase) -> None:
        for text in self.findobj(Text):
            if isinstance(text, Text) and (shown := plain_lines(text.get_text())) != text.get_text():
                text.set_text(shown)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            super().draw(renderer)


_GREY, _RULE, _SHADE = "#6b6b6b", "#dddddd", "#f2c14e"
_DASHES = {"solid": "-", "dash": (0, (5, 2)), "dot": (0, (1.2, 1.4)), "dashdot": (0, (5, 1.5, 1.2, 1.5))}
_SYMBOLS = {"circle": "o", "square": "s", "diamond": "D"}
_HEAD = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_DECIMALS = re.compile(r"-?\d+\.\d{2,}")
_FONTS = re.compile(r"font-family: [^;]*sans-serif")
_HEIGHTS_INCH: dict[Frame, float] = {"straight": 1.8, "targets": 1.8, "plane": 4.2, "polar": 3.6}
"""Chosen: three straight charts and a pair of polar charts fit on a page of A4."""
_MOST_NODES = 360
"""Nodes of a line on paper: 1 per degree, while curves resolve 4.5° (docs/figures.md)."""
_MOST_SYMBOLS = 150
_WIDEST = 45
"""Characters of the names in a legend line."""
_PANEL_LETTERS = 62
_CAPTION_LETTERS = 150
_TAG = re.compile(r"<[^>]*>")
_SPACE = re.compile(r"\s+")


def still(picture: Picture) -> str:
    with mpl.rc_context({"path.simplify_threshold": 0.3, "font.size": 8.0}):
        sheet = Sheet(*_size_inch(picture))
        _draw_picture(sheet, picture)
        return svg_of(sheet)


def svg_of(figure: Figure, salt: str = "rig") -> str:
    """Equal figures give equal SVG. salt: different for each figure of a page, because it makes the names of their
    parts.
    """
    written = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt}):
        figure.savefig(written, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))

    def tenths(number: re.Match[str]) -> str:
        return f"{float(number[0]):.1f}".removesuffix(".0")

    # Shorten the SVG: coordinates to a tenth of a point (0.04 mm on paper), no metadata, no comments
    svg = _TAG.sub(lambda tag: _DECIMALS.sub(tenths, tag[0]), _HEAD.sub("", written.getvalue()))
    return _FONTS.sub("font-family: sans-serif", _SPACE.sub(" ", svg))


def part_of(picture: Picture) -> Part:
    words = [picture.title, *textwrap.wrap(picture.caption, _CAPTION_LETTERS)]

    def draw(sheet: SubFigure) -> None:
        with mpl.rc_context({"font.size": 8.0}):
            sheet.suptitle("\n".join(words), fontsize=8.5, x=0.01, ha="left")
            _draw_picture(sheet, picture)

    return 1.3 * _size_inch(picture)[1] + 0.15 * len(words), draw


def sheet_of(
    title: Sequence[str], pictures: Sequence[Picture], more: Sequence[Part] = (), width_inch: float = 9.0
) -> Sheet:
    """Charts below each other under the lines of a title, and other parts below."""
    parts = [*map(part_of, pictures), *more]
    heights = [height for height, _ in parts]
    sheet = Sheet(width_inch, sum(heights) + 0.2 + 0.2 * len(title))
    sheet.suptitle("\n".join(title), fontsize=11)
    rows = sheet.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
    for row, (_, draw) in zip(rows, parts, strict=True):
        draw(row)
    return sheet


def _size_inch(picture: Picture) -> tuple[float, float]:
    if isinstance(picture, SphereChart):
        return 5.4, 3.6
    if picture.panels:
        return 6.9, 0.5 + 1.45 * -(-len(picture.panels) // 2)
    return 3.4 if picture.frame == "polar" else 6.9, _HEIGHTS_INCH[picture.frame]


def _draw_picture(sheet: FigureBase, picture: Picture) -> None:
    if isinstance(picture, SphereChart):
        _sphere(sheet, picture)
    elif picture.frame == "polar":
        _polar(sheet, picture)
    elif picture.panels:
        _panels(sheet, picture)
    else:
        axes: Axes = sheet.subplots()
        _lay_out(axes, picture)
        _legend(sheet, axes, picture)


def _panels(sheet: FigureBase, chart: Chart) -> None:
    rows = -(-len(chart.panels) // 2)
    panels = sheet.subplots(rows, 2, sharex=True, sharey=True, squeeze=False).ravel()
    for step, (name, axes) in enumerate(zip(chart.panels, panels, strict=False)):
        _lay_out(axes, chart.at_step(step), shared=True)
        axes.set_title(textwrap.fill(f"{step}  {name}", _PANEL_LETTERS), fontsize=7, loc="left")
        axes.set_ylim(*chart.reach)
    for axes in panels[len(chart.panels) :]:
        axes.set_axis_off()
    for axes in panels[-2:]:
        axes.set_xlabel(chart.x_label)
    sheet.supylabel(chart.y_label, fontsize=8)
    _legend(sheet, panels[0], chart)


def _legend(sheet: FigureBase, axes: Axes, chart: Chart) -> None:
    is_wide = sum(len(line.name) for line in chart.lines) > _WIDEST
    columns = 3 if is_wide else len(chart.lines)
    sheet.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns, frameon=False)


def _lay_out(axes: Axes, chart: Chart, *, shared: bool = False) -> None:
    """shared: without axis labels, which are common to all panels."""
    for line in chart.lines:
        _draw(axes, line)
    for low, high in chart.shaded:
        axes.axvspan(low, high, color=_SHADE, alpha=0.35, lw=0, zorder=0)
    for at_deg, text in chart.marks:
        axes.axvline(at_deg, color=_GREY, lw=0.7, ls=":")
        axes.text(
            at_deg, 1.02, "" if shared else text, transform=axes.get_xaxis_transform(), rotation=45, fontsize=6.5,
            color=_GREY,
        )  # fmt: skip
    if chart.frame == "straight":
        axes.set_xlim(0, 360)
        each = range(0, 361, 90 if shared else 30)
        axes.set_xticks(each, [f"{angle}°" for angle in each])
    if chart.ticks:
        axes.set_xticks([at for at, _ in chart.ticks], [name for _, name in chart.ticks])
    if chart.frame == "plane":
        axes.set_aspect("equal")
    if chart.span:
        axes.set_ylim(*chart.span)
    if not shared:
        axes.set_xlabel(chart.x_label)
        axes.set_ylabel(chart.y_label)
    axes.grid(color=_RULE, lw=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def _draw(axes: Axes, line: ChartLine) -> None:
    look = ROLE_STYLES[line.role]
    if not line.points:
        every = max(1, len(line.x) // _MOST_NODES)
        x, y = line.x[::every], line.y[::every]
        axes.plot(x, y, ls=_DASHES[look.dash], lw=look.width, color=look.light, label=line.name)
        return
    size, symbol = (3, "o") if len(line.x) > _MOST_SYMBOLS else (4, _SYMBOLS[look.symbol])
    style: dict[str, Any] = {"ls": "", "marker": symbol, "ms": size, "color": look.light, "elinewidth": 0.8}
    axes.errorbar(line.x, line.y, line.half, label=line.name, **style)


def _polar(sheet: FigureBase, chart: Chart) -> None:
    axes = sheet.add_subplot(projection="polar")
    assert isinstance(axes, PolarAxes)  # noqa: S101 - for the type checker
    axes.plot(np.linspace(0.0, 2 * np.pi, 181), np.zeros(181), color=_GREY, lw=0.8, ls=":")
    for line in chart.lines:
        _draw(axes, replace(line, x=np.radians(np.append(line.x, line.x[0])), y=np.append(line.y, line.y[0])))
    axes.set_rlim(-chart.hole, 1.4 * chart.largest)
    axes.set_xticks(np.radians(range(0, 360, 30)), [f"{angle}°" for angle in range(0, 360, 30)])
    axes.set_yticks([0, chart.largest], ["", f"+{chart.largest_shown} {chart.unit}"], color=_GREY)
    axes.set_rlabel_position(45.0)
    axes.grid(color=_RULE, lw=0.5)
    axes.spines["polar"].set_visible(False)
    sheet.legend(loc="outside lower center", ncols=len(chart.lines), frameon=False)


def _sphere(sheet: FigureBase, chart: SphereChart) -> None:
    from mpl_toolkits.mplot3d import Axes3D  # noqa: PLC0415 - slow to import, needed here only

    axes = sheet.add_subplot(projection="3d")
    assert isinstance(axes, Axes3D)  # noqa: S101 - for the type checker
    sphere, surface, targets = chart.words
    axes.plot_wireframe(*np.moveaxis(chart.grid * chart.radius_mm, -1, 0), color=_GREY, lw=0.4, label=sphere)
    measured = np.moveaxis(chart.chart_points(chart.grid, chart.grid_deviation_mm), -1, 0)
    axes.plot_wireframe(*measured, color=ROLE_STYLES["measured"].light, lw=0.8, label=surface)
    at = np.moveaxis(chart.chart_points(chart.targets, chart.deviation_mm), -1, 0)
    axes.plot(*at, ls="", marker="o", ms=2.5, color="black", label=targets)
    axes.set_box_aspect((2.0, 2.0, 1.0), zoom=0.85)  # proportions of a hemisphere
    axes.view_init(elev=28, azim=-45)
    for name in "xyz":
        getattr(axes, f"set_{name}label")(f"{name} / mm")
    sheet.legend(loc="outside lower center", ncols=3, frameon=False)
