"""Grammars by dialect."""

from __future__ import annotations

from tests.worlds.languages import draw_abb, draw_fanuc, draw_kuka, draw_ur, draw_yaskawa
from tests.worlds.languages.drawing import Draft, Pen

_GRAMMARS: dict[str, type[Pen]] = {
    module.Writer.dialect: module.Writer for module in (draw_ur, draw_kuka, draw_abb, draw_fanuc, draw_yaskawa)
}


def draw(dialect: str, seed: int, *, plain: bool) -> Draft:
    """Program for a seed, with all features of the grammar, or a plain one with a single tool and frame."""
    return _GRAMMARS[dialect](seed, plain=plain).draft()
