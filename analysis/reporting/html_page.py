"""One HTML file: its name, templates whose text is plain and escaped, and a write that keeps the old page until the new
one is whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from analysis.files.write import refuse_foreign
from daq.store import durable
from rigs.errors import FileError, UseError
from rigs.text import plain_lines

if TYPE_CHECKING:
    from jinja2 import Environment


def is_page(file: Path) -> bool:
    """Whether a name is that of a page."""
    return file.suffix.lower() in (".html", ".htm")


def hold_page(file: Path) -> None:
    """Raises UseError unless a file can be a page: its name says so, since browsers go by the name. Raises FileError
    where it is there and is no page of rig."""
    if not is_page(file):
        raise UseError(str(file), "is not the name of a page", "give --output FILE.html")
    refuse_foreign(file)


def environment() -> Environment:
    """Return the templates of this package; what they show of a value is plain text, escaped, unless it is HTML
    already."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - slow, needed here only

    return Environment(
        loader=PackageLoader("analysis"), autoescape=True, undefined=StrictUndefined, finalize=_plain,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip


def write_html(html: str, file: Path) -> None:
    """Write a page, in place of one that is there. Raises FileError where that is no page of rig, and where it cannot
    be written."""
    refuse_foreign(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        durable.replace(file.resolve(), html.encode())
    except OSError as error:
        raise FileError(str(file), error.strerror or str(error), "give another --output") from None


def _plain(value: object) -> object:
    return value if isinstance(value, Markup) or not isinstance(value, str) else plain_lines(value)
