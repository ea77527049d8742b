"""Wrap the long lines of generated Markdown pages."""

from __future__ import annotations

import re
import textwrap

WIDTH = 120
"""Columns of a line, as in the hand-written pages and in the source code."""
_KEPT = ("|", "#", "!", "<")
"""Beginnings of lines that are one element of Markdown: table rows, headings, pictures and HTML."""
_KEPT_SPACE = "\0"


def wrapped(page: str) -> str:
    """A page with its long paragraphs and list items wrapped; code and tables are unchanged."""
    lines: list[str] = []
    in_code = False
    for line in page.split("\n"):
        in_code ^= line.startswith("```")
        keep = in_code or len(line) <= WIDTH or line.startswith(_KEPT)
        lines += [line] if keep else _wrapped_line(line)
    return "\n".join(lines)


def _wrapped_line(line: str) -> list[str]:
    """Wrap a line, indented below the text of a list item, except within code."""
    marker = re.match(r" *(?:- )?", line)
    indent = " " * marker.end() if marker else ""
    whole = re.sub(r"`[^`]*`", lambda code: code[0].replace(" ", _KEPT_SPACE), line)
    lines = textwrap.wrap(
        whole, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    )
    return [one.replace(_KEPT_SPACE, " ") for one in lines]
