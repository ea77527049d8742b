"""Numbers that can be read from across the cell: figures of half-block cells, in whole multiples of a small size."""

from __future__ import annotations

from analysis.live.canvas import Area

_SHAPES: dict[str, tuple[str, ...]] = {
    "0": ("###", "# #", "# #", "# #", "###"),
    "1": (" # ", "## ", " # ", " # ", "###"),
    "2": ("###", "  #", "###", "#  ", "###"),
    "3": ("###", "  #", " ##", "  #", "###"),
    "4": ("# #", "# #", "###", "  #", "  #"),
    "5": ("###", "#  ", "###", "  #", "###"),
    "6": ("###", "#  ", "###", "# #", "###"),
    "7": ("###", "  #", "  #", "  #", "  #"),
    "8": ("###", "# #", "###", "# #", "###"),
    "9": ("###", "# #", "###", "  #", "###"),
    "-": ("   ", "   ", "###", "   ", "   "),
    "+": ("   ", " # ", "###", " # ", "   "),
    ".": (" ", " ", " ", " ", "#"),
    " ": ("   ", "   ", "   ", "   ", "   "),
}
_PIXEL_ROWS = 5
_HALVES = {(False, False): " ", (True, False): "▀", (False, True): "▄", (True, True): "█"}


def width_of(text: str, scale: int) -> int:
    """Return the columns that a number takes."""
    return scale * (sum(len(_SHAPES[character][0]) + 1 for character in text) - 1)


def height_of(scale: int) -> int:
    """Return the rows that a number takes."""
    return (_PIXEL_ROWS * scale + 1) // 2


def put_large(area: Area, row: int, column: int, text: str, scale: int, style: str) -> None:
    """Write a number of digits, sign, point and spaces with its upper left corner at a cell."""
    for character in text:
        shape = _SHAPES[character]
        pixels = [line for line in shape for _ in range(scale)]
        pixels += [" " * len(shape[0])] * (len(pixels) % 2)
        for k in range(0, len(pixels), 2):
            upper, lower = ("".join(pixel * scale for pixel in line) for line in pixels[k : k + 2])
            blocks = "".join(_HALVES[a == "#", b == "#"] for a, b in zip(upper, lower, strict=True))
            area.put(row + k // 2, column, blocks, style)
        column += scale * (len(shape[0]) + 1)
