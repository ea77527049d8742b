"""A figure whose text is plain (`rigs.text`) and never mathematics: `$\\frac{$` in a name is a name.

matplotlib takes what stands between two dollar signs as a formula and fails on one that it cannot read; nothing in
these pictures is one. What its font cannot draw it draws as a box, and the warning about it is left out.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import BinaryIO

import matplotlib as mpl
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure, SubFigure
from matplotlib.text import Text

from rigs.text import plain_lines

mpl.rcParams["text.parse_math"] = False


def as_png(draw: Callable[[], Figure], dpi: int = 150) -> Callable[[BinaryIO], None]:
    """What writes a picture to a file, drawn as late as that: some hundred at once would not fit into memory."""
    return lambda file: draw().savefig(file, format="png", dpi=dpi)


Part = tuple[float, Callable[[SubFigure], None]]
"""A part of a sheet: its height in inches, and what draws it."""


class Sheet(Figure):
    """A figure of this package, laid out without overlaps."""

    @classmethod
    def of_parts(cls, title: Sequence[str], parts: Sequence[Part], width_inch: float) -> Sheet:
        """Return a sheet with parts below each other under lines of a title, as high as it needs."""
        heights = [height for height, _ in parts]
        sheet = cls(width_inch, sum(heights) + 0.2 + 0.2 * len(title))
        sheet.suptitle("\n".join(title), fontsize=11)
        rows = sheet.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, (_, draw) in zip(rows, parts, strict=True):
            draw(row)
        return sheet

    def __init__(self, width_inch: float, height_inch: float) -> None:
        super().__init__(figsize=(width_inch, height_inch), layout="constrained")

    def draw(self, renderer: RendererBase) -> None:
        """Draw the figure after its text was made plain."""
        for text in self.findobj(Text):
            if isinstance(text, Text) and (shown := plain_lines(text.get_text())) != text.get_text():
                text.set_text(shown)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            super().draw(renderer)
