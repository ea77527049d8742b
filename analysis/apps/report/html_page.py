"""Writing of a page as HTML or PDF; an old page stays until the new one is complete.

WeasyPrint, an optional dependency, makes the PDF with the still pictures. It runs no scripts and loads no external
resources.
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
from rigs.text import escape_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jinja2 import Environment

    from analysis.apps.report.blocks import Block


def is_page(file: Path) -> bool:
    return file.suffix.lower() in (".html", ".htm")


def check_page_file(file: Path) -> None:
    """Raise UseError for another suffix, by which browsers know a page, and FileError for an existing file of another
    program.
    """
    if not is_page(file):
        raise UseError(str(file), "is not the name of a page", "give --output FILE.html", code="output.invalid")
    refuse_foreign(file)


def environment() -> Environment:
    """Templates of this package, which insert values as plain, escaped text unless they are HTML."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - slow, needed here only

    def plain(value: object) -> object:
        return escape_lines(value) if isinstance(value, str) and not isinstance(value, Markup) else value

    return Environment(
        loader=PackageLoader("analysis"), autoescape=True, undefined=StrictUndefined, finalize=plain,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip


def answer_page(
    title: str,
    blocks: Sequence[Block],
    lang: str = "en",
    *,
    boxed: int = 1,
    made_of: str = "",
    overview: str = "",
    sections: Sequence[tuple[str, Sequence[Block]]] = (),
) -> str:
    """An answer as a page, its first blocks in a box.

    made_of: digest of the inputs. overview: address of a linked page. sections: headings and the blocks that open
    behind them.
    """
    given = {"title": title, "blocks": blocks, "lang": lang, "boxed": boxed, "made_of": made_of, "overview": overview}
    return environment().get_template("answer.html").render(**given, sections=sections)


def write_html(html: str, file: Path) -> None:
    """Raises FileError if an existing file is no page of rig."""
    refuse_foreign(file)
    _replace(file, html.encode())


def _replace(file: Path, content: bytes) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        durable.replace(file.resolve(), content)
    except OSError as error:
        raise FileError.of_os(file, error, "choose a different --output", code="output.not_writable") from None


_PANGO = "install Pango, on Debian: apt install libpangoft2-1.0-0"
_STYLE = """
.pictures, .both, .tiles, dl { display: block !important; }
figure.polar { display: inline-block; width: 49%; }
.verdict { break-inside: auto !important; }
"""
"""WeasyPrint would put the second column of a grid beyond the paper, and a verdict that does not fit on a new page."""


def is_pdf(file: Path) -> bool:
    return file.suffix.lower() == ".pdf"


def check_pdf_output(file: Path) -> None:
    """Raise CellError if WeasyPrint or Pango is missing, before a diagnosis of several minutes."""
    refuse_foreign(file)
    _weasyprint(file)


def write_pdf(html: str, file: Path) -> None:
    weasyprint = _weasyprint(file)
    fetcher = weasyprint.urls.URLFetcher(allowed_protocols={"data"})
    style = weasyprint.CSS(string=_STYLE, url_fetcher=fetcher)
    made: bytes = weasyprint.HTML(string=html, url_fetcher=fetcher).write_pdf(stylesheets=[style])
    _replace(file, made.rstrip() + b"\n" + PDF_MARK)


def _weasyprint(file: Path) -> ModuleType:
    browser = f"or write {file.with_suffix('.html').name} and print the page from a browser"
    try:
        import weasyprint  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError as error:
        raise CellError(
            str(file),
            f"needs the Python package {error.name}, which is missing",
            f"{to_install('weasyprint')}, {browser}",
            code="package.missing",
        ) from None
    except OSError:  # the text library Pango is not a Python package
        raise CellError(
            str(file), "needs the library Pango, which is missing", f"{_PANGO}, {browser}", code="package.missing"
        ) from None
    module: ModuleType = weasyprint
    return module
