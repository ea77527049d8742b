"""Count words typical of this project's former dialect in four kinds of text.

`scripts/dev english` prints, per 1000 words of docstrings, messages, page texts and documents, the frequency of marker
words in excess of twice their frequency in the docstrings of well-known packages (asyncio, email, rich, click,
pymodbus, scipy.optimize), the folders with the largest excess, and names of a single participle or preposition. A low
count does not make good prose; an increase indicates a relapse. `tests/test_english.py` limits the counts.
"""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("rigs", "daq", "analysis")
ORDINARY = {
    "it": 4.0, "that": 6.4, "one": 1.8, "no": 1.5, "where": 1.2, "so": 0.87, "its": 0.84, "there": 0.62, "left": 0.47,
    "them": 0.45, "without": 0.39, "how": 0.37, "many": 0.37, "those": 0.28, "another": 0.24, "what": 0.2,
    "whose": 0.15, "else": 0.13, "whole": 0.12, "own": 0.11, "nothing": 0.08, "words": 0.08, "again": 0.07, "far": 0.06,
    "kept": 0.06, "holds": 0.06, "come": 0.05, "goes": 0.05, "away": 0.05, "yet": 0.05, "comes": 0.04, "held": 0.04,
    "everything": 0.03, "begins": 0.02, "behind": 0.02, "lies": 0.02, "say": 0.02, "told": 0.02, "alone": 0.01,
    "asked": 0.01, "asks": 0.01, "came": 0.01, "person": 0.01, "says": 0.01, "why": 0.01, "beside": 0.0, "judged": 0.0,
    "stand": 0.0, "stands": 0.0,
}  # fmt: skip
"""Occurrences of each marker word in 1000 words of the docstrings of well-known packages (0.7 million words)."""
_BARE = """
above along alone apart around asked away below beside between beyond built called deed done drawn extra far forget
found given held here kept known left like looked lose lost made means missing most named off over perhaps remains
rest said same seen shown stands straight taken them there those told under wanted whole within worth
"""
BARE = frozenset(_BARE.split())
"""Participles, prepositions and adverbs that are uninformative as the complete name of a function or class."""
LEAST_WORDS = 5
"""Minimum number of words of a string that counts as a message."""
_HEADLESS = re.compile(r"(?:returns? )?(?:what|where|how|who|which)\b", re.IGNORECASE)
_NO_PROSE = re.compile(r"`[^`]*`|<[^>]*>|\{[^}]*\}|https?:\S+")


def words_of(text: str) -> list[str]:
    """Return the lower-case words of a text, without code, tags, placeholders and addresses."""
    return re.findall(r"[a-z]+(?:'[a-z]+)?", _NO_PROSE.sub(" ", text.lower()))


def excess_of(counts: Counter[str]) -> float:
    """Return the marker words per 1000 words in excess of twice the ordinary frequency."""
    total = max(sum(counts.values()), 1)
    return sum(max(1000 * counts[word] / total - 2 * ordinary, 0.0) for word, ordinary in ORDINARY.items())


def docstrings_in(tree: ast.AST) -> list[ast.Constant]:
    """Return the docstrings of a module, including strings below constants."""
    return [
        statement.value
        for node in ast.walk(tree)
        if isinstance(getattr(node, "body", None), list)
        for statement in node.body  # type: ignore[attr-defined]
        if isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    ]


def modules() -> Iterator[tuple[Path, ast.Module]]:
    """Yield the modules of the packages with their syntax trees."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


def documents() -> Iterator[str]:
    """Yield the prose of the Markdown documents."""
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")):
        yield re.sub(r"```.*?```", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)


def counts() -> tuple[dict[str, float], dict[str, float]]:
    """Return the counts by name, and the excess of docstrings by folder."""
    docs, messages, names = Counter[str](), Counter[str](), defaultdict[str, set[Path]](set)
    folders, headless, bare = defaultdict[str, Counter[str]](Counter), 0, 0
    for path, tree in modules():
        own = docstrings_in(tree)
        for constant in own:
            text = str(constant.value)
            docs.update(words_of(text))
            folders[str(path.parent)].update(words_of(text))
            headless += bool(_HEADLESS.match(text.strip()))
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in own:
                messages.update(words_of(node.value) if len(node.value.split()) >= LEAST_WORDS else ())
            if isinstance(node, ast.ClassDef):
                names[node.name].add(path)
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                bare += node.name.strip("_").lower() in BARE
    texts, prose = Counter[str](), Counter[str]()
    for path in (ROOT / "analysis").rglob("texts*.en.yaml"):
        texts.update(words_of(path.read_text(encoding="utf-8")))
    for document in documents():
        prose.update(words_of(document))
    found = {
        "docstrings": excess_of(docs), "messages": excess_of(messages), "page texts": excess_of(texts),
        "documents": excess_of(prose), "docstrings without a noun or verb first": float(headless),
        "names of a participle or preposition": float(bare),
        "class names in several files": float(sum(len(paths) > 1 for paths in names.values())),
    }  # fmt: skip
    return found, {folder: excess_of(counter) for folder, counter in folders.items()}


def main() -> None:
    found, folders = counts()
    for name, value in found.items():
        print(f"{value:8.1f}  {name}")
    for folder, value in sorted(folders.items(), key=lambda entry: -entry[1])[:10]:
        print(f"    {value:6.1f}  {folder}")


if __name__ == "__main__":
    main()
