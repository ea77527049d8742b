"""Contents of a chart, and its drawing for paper: as SVG in the page, and as part of a PNG.

The script of the page draws the interactive version from `live`; `still` is for printing and for browsers without
scripts. Text stays text, in any font of the reader. Formula parsing is off, because names may contain two dollar signs.
"""

from __future__ import annotations

import base64
import io
import math
import re
import textwrap
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.projections.polar import PolarAxes
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from analysis.apps.report.texts import Texts
from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.tabular import pick_fields
from rigs.text import escape_lines, escape_text, escape_values

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

Role = Literal["acw", "cw", "measured", "model", "after", "quiet", "fifth", "sixth"]
"""Meaning of a line; determines colour, dash and symbol together, so that no meaning depends on colour only."""
Frame = Literal["straight", "polar", "targets", "plane"]
"""Horizontal axis: circle angle, straight or polar, target number, or a plane with equal scales."""
_HOLE = 2.6
"""Radius of the zero circle in a polar chart, in units of the largest deviation, as in roundness diagrams."""
_ACROSS_DEG, _ABOVE_DEG = 60.0, 22.0
"""View of an arm. Chosen: links and places hide each other least."""
_SAME_DEG = 8.0
"""Distance of marks on the circle below which they share a label."""


@dataclass(frozen=True)
class RoleStyle:
    """Colours on light and dark paper, dashes, and symbol of points.

    Orange, blue and green are distinguishable with colour blindness (Okabe and Ito), and dashes in black and white.
    """

    light: str
    dark: str
    dash: Literal["solid", "dash", "dot", "dashdot"]
    symbol: Literal["circle", "square", "diamond"]
    width: float = 1.2


ROLE_STYLES: dict[Role, RoleStyle] = {
    "acw": RoleStyle("#b34700", "#ffa14d", "solid", "circle"),
    "cw": RoleStyle("#0060a8", "#6cb8ff", "dash", "square"),
    "measured": RoleStyle("#e08a4a", "#b0703c", "solid", "circle", 3.2),
    "model": RoleStyle("#0060a8", "#6cb8ff", "dash", "square"),
    "after": RoleStyle("#004d36", "#7fe8c4", "dot", "diamond"),
    "quiet": RoleStyle("#6b6b6b", "#a8a8a8", "dot", "circle"),
    "fifth": RoleStyle("#7d2c83", "#dd9fe2", "dashdot", "square"),
    "sixth": RoleStyle("#1c1c1c", "#ececec", "solid", "diamond", 0.8),
}


@dataclass(frozen=True)
class ChartLine:
    """Values y (n,) at x (n,).

    half (n,): half length of the error bars. steps (steps, n): values at each step of an animated chart; y is the last.
    """

    name: str
    role: Role
    x: Array
    y: Array
    points: bool = False
    half: Array | None = None
    steps: Array | None = None


Marks = tuple[tuple[float, str], ...]
"""Places on the circle in degrees, each with a text."""


@dataclass(frozen=True)
class Chart:
    """shaded (from, to): in degrees of the circle. ticks: names at the positions x of the targets."""

    title: str
    caption: str
    frame: Frame
    x_label: str
    y_label: str
    unit: str
    lines: tuple[ChartLine, ...]
    marks: Marks = ()
    shaded: tuple[tuple[float, float], ...] = ()
    ticks: tuple[tuple[float, str], ...] = ()
    panels: tuple[str, ...] = ()
    """Names of the steps; paper shows a panel for each."""
    span: tuple[float, float] | None = None
    """Range of the vertical axis on paper, common to several charts."""

    @property
    def steps(self) -> int:
        return max((len(line.steps) for line in self.lines if line.steps is not None), default=0)

    def at_step(self, step: int) -> Chart:
        lines = [line if line.steps is None else replace(line, y=line.steps[step], steps=None) for line in self.lines]
        return replace(self, lines=tuple(lines))

    @property
    def reach(self) -> tuple[float, float]:
        every = [line.y if line.steps is None else line.steps for line in self.lines]
        low, high = min(float(values.min()) for values in every), max(float(values.max()) for values in every)
        room = 0.06 * max(high - low, 1e-9)
        return low - room, high + room

    @property
    def largest(self) -> float:
        """Scale of a polar chart."""
        return max(1e-9, *(float(np.abs(line.y).max()) for line in self.lines))

    @property
    def largest_shown(self) -> str:
        return f"{float(f'{self.largest:.2g}'):g}"

    @property
    def hole(self) -> float:
        return _HOLE * self.largest


@dataclass(frozen=True)
class SphereChart:
    """A measured surface around the least-squares sphere, with the largest deviation drawn as a fifth of the radius.

    grid: directions (n, m, 3) with grid_deviation_mm (n, m). targets: directions (t, 3) with deviation_mm (t,).
    """

    title: str
    caption: str
    radius_mm: float
    grid: Array
    grid_deviation_mm: Array
    targets: Array
    deviation_mm: Array
    names: tuple[str, ...]
    words: tuple[str, str, str]
    """Names of the sphere, the surface and the targets."""
    frame: Literal["sphere"] = "sphere"

    @property
    def magnified(self) -> float:
        largest = max(float(np.abs(self.deviation_mm).max()), float(np.abs(self.grid_deviation_mm).max()), 1e-9)
        return 0.2 * self.radius_mm / largest

    def chart_points(self, direction: Array, deviation_mm: Array) -> Array:
        """Positions (..., 3) mm of points with a deviation (...) mm in a direction (..., 3), magnified."""
        place: Array = direction * (self.radius_mm + self.magnified * deviation_mm)[..., None]
        return place


@dataclass(frozen=True)
class ErrorVectors:
    """Errors (n, 3) mm of the places of an arm chart; NaN for a place without one."""

    name: str
    role: Role
    errors_mm: Array

    @property
    def there(self) -> Mask:
        """True (n,) for the places with an error."""
        return np.asarray(np.isfinite(self.errors_mm).all(axis=1))

    @property
    def sizes_mm(self) -> Array:
        return np.asarray(np.linalg.norm(self.errors_mm, axis=1))


@dataclass(frozen=True)
class ArmChart:
    """Error vectors of poses and the links of the arm in one posture, in the frame of the base.

    links (k, 3) mm: corners of the arm from the base to the tool. joints (axes, 3) mm. places (n, 3) mm: commanded
    positions of the tool, with their names.
    """

    title: str
    caption: str
    arm: str
    """Name of the drawn arm."""
    links: Array
    joints: Array
    places: Array
    names: tuple[str, ...]
    vectors: tuple[ErrorVectors, ...]
    magnified: float
    frame: Literal["arm"] = "arm"

    @property
    def azimuth_deg(self) -> float:
        """Direction of the view: across the direction from the base to the places, from above."""
        x, y, _ = self.places.mean(axis=0) - self.links[0]
        return math.degrees(math.atan2(y, x)) - _ACROSS_DEG

    def ends(self, vectors: ErrorVectors) -> Array:
        """Positions (n, 3) mm of the tips of magnified vectors."""
        return np.asarray(self.places + self.magnified * vectors.errors_mm)


Picture = Chart | SphereChart | ArmChart


def marks_of(turns: Iterable[tuple[float, int]], texts: Texts) -> Marks:
    """Marks of reversals, given as angle in degrees and axis. The first of close marks names the axes of all."""
    marks, axes = dict[float, str](), list[int]()
    first_deg = -math.inf
    for at_deg, axis in sorted(turns):
        if at_deg - first_deg >= _SAME_DEG:
            first_deg, axes = at_deg, []
        axes.append(axis)
        marks[at_deg] = ""
        marks[first_deg] = texts("marked", axes=", ".join(map(str, dict.fromkeys(axes))))
    return tuple(marks.items())


def stretches(places: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    parts: list[tuple[float, float]] = []
    for low, high in places:
        parts += [(low, high)] if low <= high else [(low, 360.0), (0.0, high)]
    return tuple(parts)


def live(picture: Picture) -> dict[str, Any]:
    """Contents for the script of the page (`templates/report.js`), which draws them with plotly."""
    if isinstance(picture, SphereChart):
        contents = pick_fields(picture, "frame", "names", "words") | {
            "sphere": _places(picture.grid * picture.radius_mm),
            "surface": _places(picture.chart_points(picture.grid, picture.grid_deviation_mm)),
            "targets": _places(picture.chart_points(picture.targets, picture.deviation_mm)),
            "deviation": picture.grid_deviation_mm.round(6).tolist(),
            "limit": float(np.abs(picture.deviation_mm).max()),
        }
    elif isinstance(picture, ArmChart):
        contents = pick_fields(picture, "frame", "arm", "names", "azimuth_deg") | {
            "links": _places(picture.links),
            "joints": _places(picture.joints),
            "places": _places(picture.places),
            "vectors": [_segments(picture, vectors) for vectors in picture.vectors],
        }
    else:
        names = ["frame", "x_label", "y_label", "unit", "marks", "shaded", "ticks", "steps"]
        names += ["hole", "largest", "largest_shown"] if picture.frame == "polar" else []
        names += ["reach"] if picture.steps else []
        lines = [{name: _packed(value) for name, value in vars(line).items()} for line in picture.lines]
        contents = pick_fields(picture, *names) | {"lines": lines}
    plain: dict[str, Any] = escape_values(contents)
    return plain


def _places(points: Array) -> dict[str, Any]:
    return {axis: values.round(4).tolist() for axis, values in zip("xyz", np.moveaxis(points, -1, 0), strict=True)}


def _segments(picture: ArmChart, vectors: ErrorVectors) -> dict[str, Any]:
    """Coordinates of start and end of each vector, followed by a gap."""
    ends = picture.ends(vectors)
    corners = np.stack([picture.places, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 3)
    return {"name": vectors.name, "role": vectors.role} | dict(zip("xyz", map(_base64, corners.T), strict=True))


def _packed(value: object) -> object:
    """An array, or each of its rows, in single precision: finer than the screen, at a third of the size of text."""
    if not isinstance(value, np.ndarray):
        return value
    return _base64(value) if value.ndim == 1 else list(map(_base64, value))


def _base64(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


mpl.rcParams["text.parse_math"] = False


def as_png(draw: Callable[[], Figure], dpi: int = 150) -> Callable[[BinaryIO], None]:
    """Draw a picture only when it is written: hundreds of figures would not fit into memory."""
    return lambda file: draw().savefig(file, format="png", dpi=dpi)


Part = tuple[float, Callable[[SubFigure], None]]
"""Height in inches, and drawing function."""


class Sheet(Figure):
    """A figure with constrained layout. Characters missing in the font become boxes without a warning.

    To save a figure, matplotlib draws it twice: on a disabled renderer, for the layout, and then without the layout
    engine. Here the first pass computes only the layout.
    """

    def __init__(self, width_inch: float, height_inch: float) -> None:
        super().__init__(figsize=(width_inch, height_inch), layout="constrained")

    def draw(self, renderer: RendererBase) -> None:
        engine = self.get_layout_engine()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            if not isinstance(engine, ConstrainedLayoutEngine):
                super().draw(renderer)
                return
            for text in self.findobj(Text):
                if isinstance(text, Text) and (shown := escape_lines(text.get_text())) != text.get_text():
                    text.set_text(shown)
            engine.execute(self)


_GREY, _RULE, _SHADE, _ARM = "#6b6b6b", "#dddddd", "#f2c14e", "#c4c4c4"
_DASHES = {"solid": "-", "dash": (0, (5, 2)), "dot": (0, (1.2, 1.4)), "dashdot": (0, (5, 1.5, 1.2, 1.5))}
_SYMBOLS = {"circle": "o", "square": "s", "diamond": "D"}
_HEAD = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>|<!--.*?-->", re.DOTALL)
_DECIMALS = re.compile(r"-?\d+\.\d{2,}")
_FONTS = re.compile(r"font-family: [^;]*sans-serif")
_HEIGHTS_INCH: dict[Frame, float] = {"straight": 1.8, "targets": 2.0, "plane": 4.2, "polar": 3.6}
"""Chosen: three straight charts and a pair of polar charts fit on a page of A4."""
_MOST_NODES = 360
"""Nodes of a line on paper: 1 per degree, while curves resolve 4.5° (docs/figures.md)."""
_MOST_SYMBOLS = 150
_LETTERS_PER_INCH, _SYMBOL_LETTERS, _LEGEND_ROWS_PER_INCH = 16, 5, 6
"""Size of the names in a legend, and of the symbol before each, in a font of 8 points."""
_LEGEND_SHARE = 0.4
"""Largest share of the height for a legend. Chosen: four rows below the lowest chart, whose curves need the rest."""
_PANEL_LETTERS, _Y_LETTERS = 62, 22
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
    if isinstance(picture, ArmChart):
        return 5.6, 4.4
    if picture.panels:
        return 6.9, 0.5 + 1.45 * -(-len(picture.panels) // 2)
    return 3.4 if picture.frame == "polar" else 6.9, _HEIGHTS_INCH[picture.frame]


def _draw_picture(sheet: FigureBase, picture: Picture) -> None:
    if isinstance(picture, SphereChart):
        _sphere(sheet, picture)
    elif isinstance(picture, ArmChart):
        _arm(sheet, picture)
    elif picture.frame == "polar":
        _polar(sheet, picture)
    elif picture.panels:
        _panels(sheet, picture)
    else:
        axes: Axes = sheet.subplots()
        _lay_out(axes, picture)
        _legend(sheet, axes)


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
    _legend(sheet, panels[0])


def _legend(sheet: FigureBase, axes: Axes) -> None:
    """Names below the axes. Long names are shortened if the legend would leave no room for the curves."""
    handles, labels = axes.get_legend_handles_labels()
    names = [escape_text(label) for label in labels]
    box, dpi = axes.figure.bbox, axes.figure.dpi
    letters = _LETTERS_PER_INCH * box.width / dpi
    rows = max(1, int(_LEGEND_SHARE * _LEGEND_ROWS_PER_INCH * box.height / dpi))
    fitting = int(letters / (_SYMBOL_LETTERS + max(map(len, names), default=1)))
    columns = min(max(fitting, -(-len(names) // rows), 1), len(names))
    longest = int(letters / max(columns, 1)) - _SYMBOL_LETTERS
    shown = [name if len(name) <= longest else f"{name[: longest - 1]}…" for name in names]
    sheet.legend(handles, shown, loc="outside lower center", ncols=columns, frameon=False)


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
        axes.set_xticks(range(0, 361, 90 if shared else 30))
        axes.xaxis.set_major_formatter("{x:.0f}°")
    if chart.ticks:
        axes.set_xticks([at for at, _ in chart.ticks], [name for _, name in chart.ticks])
    if chart.frame == "plane":
        axes.set_aspect("equal")
    if chart.span:
        axes.set_ylim(*chart.span)
    if not shared:
        axes.set(xlabel=chart.x_label, ylabel=textwrap.fill(chart.y_label, _Y_LETTERS))
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
    axes.set_thetagrids(range(0, 360, 30))
    axes.set_yticks([0, chart.largest], ["", f"+{chart.largest_shown} {chart.unit}"], color=_GREY)
    axes.set_rlabel_position(45.0)
    axes.grid(color=_RULE, lw=0.5)
    axes.spines["polar"].set_visible(False)
    _legend(sheet, axes)


def _space(sheet: FigureBase) -> Axes3D:
    from mpl_toolkits.mplot3d import Axes3D  # noqa: PLC0415 - slow to import, needed here only

    axes = sheet.add_subplot(projection="3d")
    assert isinstance(axes, Axes3D)  # noqa: S101 - for the type checker
    axes.set(xlabel="x / mm", ylabel="y / mm", zlabel="z / mm")
    return axes


def _sphere(sheet: FigureBase, chart: SphereChart) -> None:
    axes = _space(sheet)
    sphere, surface, targets = chart.words
    axes.plot_wireframe(*np.moveaxis(chart.grid * chart.radius_mm, -1, 0), color=_GREY, lw=0.4, label=sphere)
    measured = np.moveaxis(chart.chart_points(chart.grid, chart.grid_deviation_mm), -1, 0)
    axes.plot_wireframe(*measured, color=ROLE_STYLES["measured"].light, lw=0.8, label=surface)
    at = np.moveaxis(chart.chart_points(chart.targets, chart.deviation_mm), -1, 0)
    axes.plot(*at, ls="", marker="o", ms=2.5, color="black", label=targets)
    axes.set_box_aspect((2.0, 2.0, 1.0), zoom=0.85)  # proportions of a hemisphere
    axes.view_init(elev=28, azim=-45)
    _legend(sheet, axes)


def _arm(sheet: FigureBase, chart: ArmChart) -> None:
    axes = _space(sheet)
    axes.plot(*chart.links.T, color=_ARM, lw=4, solid_capstyle="round", solid_joinstyle="round", label=chart.arm)
    axes.plot(*chart.joints.T, ls="", marker="o", ms=4, color="white", mec=_GREY, mew=1.0)
    axes.plot(*chart.places.T, ls="", marker="o", ms=2.0, color="black")
    drawn = [chart.links, chart.places]
    for vectors in chart.vectors:
        there = vectors.there
        arrows = (chart.magnified * vectors.errors_mm[there]).T
        look = ROLE_STYLES[vectors.role]
        axes.quiver(
            *chart.places[there].T, *arrows, color=look.light, lw=1.2, arrow_length_ratio=0.25,
            label=vectors.name,
        )  # fmt: skip
        drawn.append(chart.ends(vectors)[there])
    low, high = (edge(np.concatenate(drawn), axis=0) for edge in (np.min, np.max))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.05)
    axes.view_init(elev=_ABOVE_DEG, azim=chart.azimuth_deg)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(5))
    _legend(sheet, axes)
