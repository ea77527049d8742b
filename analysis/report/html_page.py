"""One page as a file: its name, templates whose text is plain and escaped, and a write that keeps the old page until
the new one is whole; as HTML, or as a PDF by WeasyPrint, an extra of the package, with the still pictures.

WeasyPrint makes what a browser prints; it runs no script and here loads nothing but what the page holds itself.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from markupsafe import Markup

from analysis.runs.written_files import PDF_MARK, refuse_foreign
from daq.store import durable
from rigs.distribution import to_install
from rigs.errors import CellError, FileError, UseError
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

    def plain(value: object) -> object:
        return plain_lines(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    return Environment(
        loader=PackageLoader("analysis"), autoescape=True, undefined=StrictUndefined, finalize=plain,
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
        raise FileError(str(file), error.strerror or str(error), "choose a different --output") from None


_PANGO = "install Pango, on Debian: apt install libpangoft2-1.0-0"
_STYLE = """
.pictures, .both, .tiles, dl { display: block !important; }
figure.polar { display: inline-block; width: 49%; }
.verdict { break-inside: auto !important; }
"""
"""WeasyPrint puts the second column of a grid beyond the edge of the paper, and moves a verdict that does not fit below
the head of a report to a page of its own."""


def is_pdf(file: Path) -> bool:
    """Return whether a name is that of a PDF."""
    return file.suffix.lower() == ".pdf"


def hold_pdf(file: Path) -> None:
    """Raise CellError where no PDF can be written, with what to do, and FileError where one is there that rig did not
    make; before the minutes that a diagnosis takes."""
    refuse_foreign(file)
    _weasyprint(file)


def write_pdf(html: str, file: Path) -> None:
    """Write a page as a PDF, in place of a file that is there. Raises CellError without WeasyPrint, and FileError where
    the file cannot be written."""
    weasyprint = _weasyprint(file)
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols={"data"})
    style = weasyprint.CSS(string=_STYLE, url_fetcher=fetcher)
    made: bytes = weasyprint.HTML(string=html, url_fetcher=fetcher).write_pdf(stylesheets=[style])
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        durable.replace(file.resolve(), made.rstrip() + b"\n" + PDF_MARK)
    except OSError as error:
        raise FileError(str(file), error.strerror or str(error), "choose a different --output") from None


def _weasyprint(file: Path) -> ModuleType:
    browser = f"or write {file.with_suffix('.html').name} and print the page from a browser"
    try:
        import weasyprint  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError as error:
        raise CellError(
            str(file), f"needs {error.name}, which is missing", f"{to_install('weasyprint')}, {browser}"
        ) from None
    except OSError:  # its library for text is no Python package
        raise CellError(str(file), "needs the library Pango, which is missing", f"{_PANGO}, {browser}") from None
    module: ModuleType = weasyprint
    return module
