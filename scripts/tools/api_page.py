"""Generate docs/api.md from the docstrings of the public API: `scripts/dev api_page > docs/api.md`.

The public API is `analysis.__all__`. Functions are in the order of their source, followed by classes with their public
fields, properties and methods, and finally errors.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import sys
import textwrap
from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

HEAD = """\
# The Python API

The functions of `rig` for scripts and notebooks. Start with the [notebook](notebook/first-steps.ipynb) (`pip install .
jupyterlab`, then `jupyter lab docs/notebook/first-steps.ipynb`), or with five lines:

```python
from analysis import evaluate, load_run

result = evaluate(load_run("runs/monday-acw"))
print(result.figures["band_deg"])  # value ± standard uncertainty
result.curve.to_table()  # error over the circle angle, a pyarrow Table
```

`RigFile` is the path of a rig file, or the name of a shipped rig or of an arm in the library. `AnyRun` is a run or the
path of a run directory. Names state the unit, in degrees and mm. Arrays without a unit in the name are in radians and
mm. `to_table()` returns a pyarrow Table; `to_frame()` of the same classes returns a pandas DataFrame if pandas is
installed. `to_dict()` returns the content of `--json` as plain types. Every expected failure is a `RigError` ([error
codes](errors.md)).

This page is generated from the docstrings: `scripts/dev api_page > docs/api.md`.
"""
_LONGEST = 100
_SECTIONS = ("Returns ", "Raises ")
_HEADINGS = ("Example:",)
_LEFT_OUT = "Source: "
"""Paragraph of a docstring for readers of the code."""
_EVERYWHERE = {"to_frame()"}
"""Methods that the head of the page describes."""
_ENTRY = re.compile(r"(?P<names>\w+(, \w+)*)( (?P<shape>\([^)]*\)))?: (?P<text>.*)")
"""Line of a parameter or field, such as `u_mm (n,): standard uncertainty`."""

_PAGE = re.compile(r"docs/(?P<name>[\w-]+)\.md")


def page() -> str:
    """Return the complete page as Markdown."""
    import analysis  # noqa: PLC0415 - the script first puts the repository on the path

    public = [getattr(analysis, name) for name in analysis.__all__]
    functions = [one for one in public if inspect.isfunction(one)]
    classes = [one for one in public if inspect.isclass(one)]
    functions.sort(key=lambda one: inspect.getsourcelines(one)[1])
    classes.sort(key=lambda one: (issubclass(one, Exception), one.__name__))
    parts = [HEAD, "## Functions\n", *map(_function, functions), "## Results and errors\n", *map(_class, classes)]
    return "\n".join(parts)


def _function(function: Callable[..., Any]) -> str:
    summary, *blocks = _paragraphs(function)
    return "\n\n".join([f"### {function.__name__}", _signature(function), _prose(summary), *blocks]) + "\n"


def _paragraphs(documented: object) -> list[str]:
    """Paragraphs of a docstring as Markdown, without the sources."""
    paragraphs = (inspect.getdoc(documented) or "").split("\n\n")
    return [_block(one) for one in paragraphs if one not in _HEADINGS and not one.startswith(_LEFT_OUT)]


def _signature(function: Callable[..., Any]) -> str:
    """Return the signature as code, with a parameter per line if it is long."""
    signature = inspect.signature(function)
    parts = [_parameter(one) for one in signature.parameters.values()]
    named = [k for k, one in enumerate(signature.parameters.values()) if one.kind is one.KEYWORD_ONLY]
    if named:
        parts.insert(named[0], "*")
    line = f"{function.__name__}({', '.join(parts)}) -> {signature.return_annotation}"
    if len(line) > _LONGEST:
        listed = "".join(f"    {part},\n" for part in parts)
        line = f"{function.__name__}(\n{listed}) -> {signature.return_annotation}"
    return f"```python\n{line}\n```"


def _parameter(one: inspect.Parameter) -> str:
    default = "" if one.default is one.empty else f" = {one.default!r}"
    return f"{one.name}: {one.annotation}{default}"


def _block(paragraph: str) -> str:
    """Convert a paragraph of prose, an example, or a list of parameters with their descriptions."""
    if paragraph.startswith("    "):
        return f"```python\n{textwrap.dedent(paragraph)}\n```"
    alike: dict[str, list[str]] = {}
    for name, text in _entries(paragraph).items():
        alike.setdefault(text, []).append(f"`{name}`")
    return _items(alike) or _prose(paragraph)


def _items(alike: dict[str, list[str]]) -> str:
    """A list item for each description, with all names that it describes."""
    return "\n".join(f"- {', '.join(names)}{text}" for text, names in alike.items())


def _entries(paragraph: str) -> dict[str, str]:
    """Descriptions by name in a paragraph such as `u_mm (n,): standard uncertainty`; empty for prose."""
    lines = paragraph.splitlines()
    if paragraph.startswith((*_SECTIONS, " ")) or not _ENTRY.match(lines[0]):
        return {}
    entries: dict[str, str] = {}
    names: list[str] = []
    for line in lines:
        if entry := _ENTRY.match(line):
            names = entry["names"].split(", ")
            text = f" {entry['shape']}" if entry["shape"] else ""
            entries |= dict.fromkeys(names, f"{text}: {_prose(entry['text'])}")
        else:
            entries |= {name: f"{entries[name]} {_prose(line)}" for name in names}
    return entries


def _prose(paragraph: str) -> str:
    """Join the lines of a paragraph, and turn each `docs/NAME.md` in it into a Markdown link."""
    return _PAGE.sub(lambda named: f"[{named['name']}]({named['name']}.md)", " ".join(paragraph.split()))


def _class(found: type) -> str:
    paragraphs = (inspect.getdoc(found) or "").split("\n\n")
    entries = {name: text for one in paragraphs for name, text in _entries(one).items()}
    entries |= {name: f": {_prose(text)}" for name, text in _documented_fields(found)}
    alike: dict[str, list[str]] = {}
    for field in dataclasses.fields(found) if dataclasses.is_dataclass(found) else ():
        text = entries.pop(field.name, "")
        alike.setdefault(text, []).append(f"`{field.name}`" if text else f"`{field.name}: {field.type}`")
    for name, text in entries.items():
        alike.setdefault(text, []).append(f"`{name}`")
    for name, text in _members(found):
        if name not in _EVERYWHERE and not text.startswith("Deprecated"):
            alike.setdefault(f": {_prose(text)}", []).append(f"`{name}`")
    prose = [_block(one) for one in paragraphs if one not in _HEADINGS and not _entries(one)]
    return "\n\n".join([f"### {found.__name__}", *prose, *([_items(alike)] if alike else [])]) + "\n"


def _documented_fields(found: type) -> list[tuple[str, str]]:
    """Names and docstrings of public fields, which Python does not keep: read from the source."""
    fields: dict[str, str] = {}
    for owner in reversed(found.__mro__):
        if not owner.__module__.startswith(("analysis", "rigs")):
            continue
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(definition, ast.ClassDef)
        for field, text in pairwise(definition.body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(doc))) if not name.startswith("_"):
                    fields[name] = inspect.cleandoc(doc)
    return list(fields.items())


def _members(found: type) -> list[tuple[str, str]]:
    """Names and docstrings of public properties and methods, except those of a public base class."""
    import analysis  # noqa: PLC0415

    public = {getattr(analysis, name) for name in analysis.__all__} - {found}
    members: dict[str, str] = {}
    for owner in reversed(found.__mro__):
        if not owner.__module__.startswith(("analysis", "rigs")) or owner in public:
            continue
        for name, value in vars(owner).items():
            shown = inspect.isfunction(value) or isinstance(value, property | cached_property)
            if shown and not name.startswith("_"):
                members[f"{name}()" if inspect.isfunction(value) else name] = inspect.getdoc(value) or ""
    return list(members.items())


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.support.markdown import wrapped

    sys.stdout.write(wrapped(page()))
