"""A picture of a terminal: what `tmux capture-pane -e -p` prints, from standard input, as PNG.

Braille and block characters are drawn as dots and rectangles, since few fonts have them at one width.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import matplotlib as mpl
import typer
from PIL import Image, ImageDraw, ImageFont
from rich.cells import cell_len
from rich.console import Console
from rich.style import Style
from rich.terminal_theme import TerminalTheme
from rich.text import Text

WIDTH, HEIGHT = 8, 16
"""Pixels of a cell."""
BACKGROUND = (16, 18, 24)
FOREGROUND = (214, 218, 224)
DIM = 0.55
XTERM = TerminalTheme(
    BACKGROUND,
    FOREGROUND,
    [(0, 0, 0), (205, 0, 0), (0, 205, 0), (205, 205, 0), (0, 0, 238), (205, 0, 205), (0, 205, 205), (229, 229, 229)],
    [
        (127, 127, 127),
        (255, 60, 60),
        (0, 255, 0),
        (255, 255, 0),
        (92, 92, 255),
        (255, 0, 255),
        (0, 255, 255),
        (255, 255, 255),
    ],
)
"""The sixteen colours of xterm; its bright red a little lighter, as small text needs."""
BRAILLE = 0x2800
PLACES = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2), (0, 3), (1, 3)]
"""Column and row of each of the eight dots."""
BLOCKS = {"█": (0, HEIGHT), "▀": (0, HEIGHT // 2), "▄": (HEIGHT // 2, HEIGHT)}
COLOURS = 64


def main(out: Annotated[Path, typer.Argument(metavar="FILE.png", help="The picture.")]) -> None:
    """Read a captured screen and write its picture."""
    lines = [Text.from_ansi(line) for line in sys.stdin.read().rstrip("\n").split("\n")]
    size = (WIDTH * max(line.cell_len for line in lines), HEIGHT * len(lines))
    image = Image.new("RGB", size, BACKGROUND)
    draw = ImageDraw.Draw(image)
    font = ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSansMono.ttf", 13)
    for row, line in enumerate(lines):
        column = 0
        for segment in line.render(Console(), end=""):
            for character in segment.text:
                _draw(draw, font, (WIDTH * column, HEIGHT * row), character, _colour(segment.style))
                column += cell_len(character)
    image.quantize(COLOURS).save(out, optimize=True)


def _colour(style: Style | None) -> tuple[int, int, int]:
    if style is None or style.color is None or style.color.is_default:
        colour = FOREGROUND
    else:
        colour = tuple(style.color.get_truecolor(XTERM))
    if style is not None and style.dim:
        colour = tuple(round(DIM * c + (1 - DIM) * b) for c, b in zip(colour, BACKGROUND, strict=True))
    return colour


def _draw(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont,
    corner: tuple[int, int],
    character: str,
    colour: tuple[int, int, int],
) -> None:
    x, y = corner
    if character in BLOCKS:
        top, bottom = BLOCKS[character]
        draw.rectangle((x, y + top, x + WIDTH - 1, y + bottom - 1), colour)
    elif BRAILLE <= ord(character) < BRAILLE + 256:
        for bit, (right, down) in enumerate(PLACES):
            if (ord(character) - BRAILLE) >> bit & 1:
                left, top = x + 1 + 4 * right, y + 1 + 4 * down
                draw.rectangle((left, top, left + 1, top + 1), colour)
    elif character != " ":
        draw.text((x, y), character, colour, font)


if __name__ == "__main__":
    typer.run(main)
