import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
SITE: dict[str, Any] = runpy.run_path(str(ROOT / "scripts" / "tools" / "website.py"))


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    directory = tmp_path_factory.mktemp("site") / "site"
    SITE["build"](directory)
    return directory


def test_every_document_is_a_page_and_every_link_leads_somewhere(site):
    assert SITE["broken"](site) == []
    for source in (ROOT / "docs").rglob("*.md"):
        path = source.relative_to(ROOT)
        page = site / (path.with_name("index.html") if path.name == "README.md" else path.with_suffix(".html"))
        assert page.exists(), path
    assert (site / "docs" / "images" / "parts.svg").read_bytes() == (ROOT / "docs/images/parts.svg").read_bytes()
    front = (site / "index.html").read_text()
    assert 'href="docs/any-arm.html"' in front
    assert "<table>" in front


def test_a_link_to_nothing_is_found(site):
    page = site / "lost.html"
    page.write_text('<a href="gone.html">x</a><a href="index.html#gone">y</a><a href="https://x.org/">z</a>')
    lost = SITE["broken"](site)
    page.unlink()
    assert [line.split()[1] for line in lost] == ["gone.html", "index.html#gone"]


def test_a_directory_that_is_no_site_is_left_alone(tmp_path, monkeypatch):
    (tmp_path / "kept").write_text("mine")
    monkeypatch.setattr("sys.argv", ["website", str(tmp_path)])
    with pytest.raises(SystemExit, match="no site"):
        SITE["main"]()
    assert (tmp_path / "kept").read_text() == "mine"
