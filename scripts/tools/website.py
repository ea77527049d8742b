"""Build the documents as a static site and check every link and anchor: `scripts/dev website [DIRECTORY]`.

Pages keep their paths, with .html in place of .md, so links stay valid. README.md becomes index.html. A linked
directory becomes a page that lists its files, and linked files are copied. Nothing is loaded from other sites. The exit
code is 1 if a link is broken.
"""

from __future__ import annotations

import argparse
import html
import os
import re
import shutil
import sys
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.token import Token

ROOT = Path(__file__).resolve().parents[2]
FRONT = (ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", ROOT / "AGENTS.md")
STYLE = """\
:root{color-scheme:light dark}body{margin:0;font:16px/1.55 system-ui,sans-serif;display:flex;flex-wrap:wrap}
nav{flex:0 0 15rem;padding:1rem;font-size:.85rem}nav a{display:block;padding:.1rem 0}main{flex:1 1 30rem;min-width:0;
max-width:60rem;padding:1rem 1.5rem}a{color:#0b57a4;text-decoration:none}a:hover{text-decoration:underline}
pre,.wide{overflow-x:auto}pre{padding:.8rem;background:#8881;border-radius:.3rem}code{font-size:.9em}img{max-width:100%;
background:#fff}table{border-collapse:collapse}td,th{border:1px solid #8886;padding:.3rem .5rem;vertical-align:top;
text-align:left}@media(prefers-color-scheme:dark){a{color:#7db7f0}}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", nargs="?", type=Path, default=Path("dist/site"), help="where to (dist/site)")
    directory = parser.parse_args().directory
    if directory.exists() and not (directory / "site.css").exists():
        sys.exit(f"error: {directory}: exists already, and is no site of this program; give another directory")
    shutil.rmtree(directory, ignore_errors=True)
    written = build(directory)
    lost = broken(directory)
    for line in lost:
        print(f"error: {line}", file=sys.stderr)
    print(f"{len(written)} pages in {directory}, {len(lost)} links that lead nowhere")
    sys.exit(bool(lost))


def build(directory: Path) -> list[Path]:
    """Write the site and return its pages."""
    sources = [*(page for page in FRONT if page.exists()), *sorted(ROOT.glob("docs/**/*.md"))]
    titles = {source: _title(source) for source in sources}
    pages, beside = list[Path](), set[Path]()
    for source in sources:
        tokens = _parsed(source)
        beside |= {target for target in _targets(source, tokens) if target not in titles and target.exists()}
        page = directory / _address(source)
        page.parent.mkdir(parents=True, exist_ok=True)
        up = os.path.relpath(directory, page.parent)
        page.write_text(_page(titles[source], _navigation(titles, up), _body(source, tokens), up), encoding="utf-8")
        pages.append(page)
    for target in beside:
        place = directory / target.relative_to(ROOT)
        if target.is_dir():
            _list(target, place, directory)
        else:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(target, place)
    (directory / "site.css").write_text(STYLE, encoding="utf-8")
    return pages


def broken(directory: Path) -> list[str]:
    """Return a line for each link to a missing file or anchor."""
    anchors = {page: set(re.findall(r' id="([^"]+)"', page.read_text("utf-8"))) for page in directory.rglob("*.html")}
    lines = []
    for page in anchors:
        for link in re.findall(r'(?:href|src)="([^"]+)"', page.read_text("utf-8")):
            path, _, anchor = html.unescape(link).partition("#")
            if re.match(r"[a-z]+:", path):
                continue
            target = Path(os.path.normpath(page.parent / unquote(path))) if path else page
            target = target / "index.html" if target.is_dir() else target
            if not target.exists() or (anchor and unquote(anchor) not in anchors.get(target, ())):
                lines.append(f"{page.relative_to(directory)}: {link} leads nowhere")
    return lines


def _parsed(source: Path) -> list[Token]:
    return MarkdownIt("commonmark").enable("table").parse(source.read_text(encoding="utf-8"))


def _title(source: Path) -> str:
    """Return the first heading of a page."""
    found = re.search(r"^# (.+)$", source.read_text(encoding="utf-8"), re.M)
    return re.sub(r"[`*]", "", found[1]) if found else source.stem


def _address(source: Path) -> Path:
    """Return the path of a document's page within the site."""
    path = source.relative_to(ROOT)
    return path.with_name("index.html") if path.name == "README.md" else path.with_suffix(".html")


def _links(tokens: Iterable[Token]) -> Iterable[tuple[Token, str]]:
    """Yield tokens that contain an address, with the name of the attribute."""
    for token in tokens:
        for name in ("href", "src"):
            if name in token.attrs:
                yield token, name
        yield from _links(token.children or ())


def _target(source: Path, link: str) -> Path | None:
    """Return the file that a link refers to, the README.md of a directory that has one; None for external addresses and
    anchors in the same page.
    """
    path = link.partition("#")[0]
    if not path or re.match(r"[a-z]+:", path):
        return None
    target = (source.parent / unquote(path)).resolve()
    return page if (page := target / "README.md").exists() else target


def _targets(source: Path, tokens: Iterable[Token]) -> Iterable[Path]:
    for token, name in _links(tokens):
        if (target := _target(source, str(token.attrs[name]))) is not None and target.is_relative_to(ROOT):
            yield target


def _body(source: Path, tokens: list[Token]) -> str:
    """Return the HTML of a page, with links to other pages adapted and with GitHub's heading anchors."""
    for token, name in _links(tokens):
        link = str(token.attrs[name])
        target = _target(source, link)
        if target is not None and target.suffix == ".md" and target.is_relative_to(ROOT) and target.exists():
            _, mark, anchor = link.partition("#")
            here = (ROOT / _address(source)).parent
            token.attrs[name] = os.path.relpath(ROOT / _address(target), here) + mark + anchor
    taken = dict[str, int]()
    for token, inline in pairwise(tokens):
        if token.type == "heading_open":
            anchor = re.sub(r"[^\w -]", "", _plain(inline).lower()).strip().replace(" ", "-")
            number = taken[anchor] = taken.get(anchor, -1) + 1
            token.attrs["id"] = f"{anchor}-{number}" if number else anchor
    markdown = MarkdownIt("commonmark").enable("table")
    text = str(markdown.renderer.render(tokens, markdown.options, {}))
    return text.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>")


def _plain(inline: Token) -> str:
    return "".join(child.content for child in inline.children or ())


def _navigation(titles: dict[Path, str], up: str) -> str:
    """Return links to the user pages; decisions and similar pages are linked from their index."""
    shown = [source for source in titles if source.parent in {ROOT, ROOT / "docs", ROOT / "docs" / "how-to"}]
    links = (f'<a href="{up}/{_address(source).as_posix()}">{html.escape(titles[source])}</a>' for source in shown)
    return "\n".join(links)


def _page(title: str, navigation: str, body: str, up: str) -> str:
    head = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
        f'content="width=device-width"><title>{html.escape(title)}</title><link rel="stylesheet" '
        f'href="{up}/site.css"></head>'
    )
    return f"{head}<body><nav>\n{navigation}\n</nav><main>\n{body}</main></body></html>\n"


def _list(source: Path, place: Path, directory: Path) -> None:
    """Write a page that lists the files of a directory, and copy these files; documents are linked to their pages."""
    place.mkdir(parents=True, exist_ok=True)
    rows = []
    for file in sorted(path for path in source.rglob("*") if path.is_file() and "__pycache__" not in path.parts):
        name = file.relative_to(source)
        if file.suffix == ".md" and file.is_relative_to(ROOT / "docs"):
            name = Path(os.path.relpath(ROOT / _address(file), source))
        else:
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place / name)
        rows.append(f'<li><a href="{html.escape(name.as_posix())}">{html.escape(file.name)}</a></li>')
    title, up = source.relative_to(ROOT).as_posix(), os.path.relpath(directory, place)
    body = f"<h1>{html.escape(title)}</h1><ul>{''.join(rows)}</ul>"
    home = f'<a href="{up}/index.html">Home</a>'
    (place / "index.html").write_text(_page(title, home, body, up), encoding="utf-8")


if __name__ == "__main__":
    main()
