import pytest

from scripts.tools import printed_pages
from tests.support.nightly import cases

PAGE = """# A page

<!-- runs -->
```sh
seq 3
printf 'error  %s ± 0.10 mm\\nwide  yes\\n' 2.71
```

It prints:

```text
1
…
error 2.70 ± 0.10 mm
wide yes
```

```sh
false
```
"""
GROUPS = printed_pages.marked_pages()


@pytest.fixture
def docs(tmp_path):
    (tmp_path / "page.md").write_text(PAGE)
    later = (
        PAGE.replace("<!-- runs -->", "<!-- runs after page.md -->").replace("seq 3", "cat left").replace("1\n…", "7")
    )
    (tmp_path / "later.md").write_text(later)
    return tmp_path


def outputs_of(page, docs):
    return dict(printed_pages.run_pages([page], docs))[page]


def test_unmarked_commands_do_not_run(docs):
    (printed,) = outputs_of("page.md", docs)
    assert printed.split()[:4] == ["1", "2", "3", "error"]


def test_rounding_is_no_difference(docs):
    assert printed_pages.drifted(PAGE, outputs_of("page.md", docs)) == []


def test_a_different_figure_is_reported_and_renewed(docs):
    page = PAGE.replace("2.70", "3.70")
    outputs = outputs_of("page.md", docs)
    (part,) = printed_pages.drifted(page, outputs)
    assert part.startswith("error 3.70")
    renewed = printed_pages.renewed(page, outputs)
    assert printed_pages.drifted(renewed, outputs) == [] and "error  2.71 ± 0.10 mm\nwide  yes\n```" in renewed


def test_a_sentence_that_is_no_longer_printed_must_be_edited(docs):
    page = PAGE.replace("error 2.70 ± 0.10 mm\nwide yes", "All is well")
    with pytest.raises(ValueError, match="All is well"):
        printed_pages.renewed(page, outputs_of("page.md", docs))


def test_a_later_page_continues_in_the_directory_of_the_first(docs):
    (docs / "page.md").write_text(PAGE.replace("seq 3", "seq 3; echo 7 > left"))
    assert printed_pages.marked_pages(docs) == {"page.md": ["page.md", "later.md"]}
    for name, outputs in printed_pages.run_pages(["page.md", "later.md"], docs):
        assert printed_pages.drifted((docs / name).read_text(), outputs) == []


@pytest.mark.parametrize("command", ["exit 2", "echo 'Traceback (most recent call last)'; exit 1"])
def test_a_command_that_fails_is_an_error(command, docs):
    with pytest.raises(RuntimeError, match="exit code"):
        printed_pages.printed_by(command, docs)


@pytest.mark.cpu_limit(400)
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("first", cases(GROUPS, {"moved.md"}))
def test_pages_print_what_is_printed(first):
    for name, outputs in printed_pages.run_pages(GROUPS[first]):
        page = (printed_pages.DOCS / name).read_text(encoding="utf-8")
        assert printed_pages.drifted(page, outputs) == [], f"scripts/dev printed_pages {name} --write"
