"""Generate docs/rig-file-reference.md from the schema: `scripts/dev rig_file_page > docs/rig-file-reference.md`.

Each mapping of a rig file has a section, named by the place of its first use, with an item for each key: type, default
and docstring of the schema. Keys common to all members of a union (every gauge, every effect) are listed once.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

HEAD = """\
# Every key of a rig file

[The rig file](rig-file.md) explains the keys with examples. Lengths are in mm and angles in degrees, as the names say.
Unlisted keys and values beyond the bounds are refused. In a heading, the word after a colon is the value of `interface`
or `effect` that selects this kind of mapping.

This page is generated from the schema: `scripts/dev rig_file_page > docs/rig-file-reference.md`.
"""
_BOUNDS = {
    "minimum": "from {:.7g}",
    "exclusiveMinimum": "above {:.7g}",
    "maximum": "to {:.7g}",
    "exclusiveMaximum": "below {:.7g}",
}
_KINDS = {"number": "number", "integer": "integer", "string": "text", "boolean": "`true` or `false`"}
_WRITTEN = {"Line": "line settings, as `9600 8N1`", "Limit": "number, which is `fail`, or {}"}
"""Mappings with a special notation in a rig file, by class; {} is the mapping."""
_CHOOSERS = ("interface", "effect")
"""Keys whose value selects the kind of a mapping."""
_LONGEST_DEFAULT = 40

Model = type[BaseModel]
Schema = dict[str, Any]


@dataclass(frozen=True)
class Shared:
    """Keys common to all members of a union, listed only with the first of them."""

    first: str
    keys: frozenset[str]


def page() -> str:
    """Return the complete page as Markdown."""
    from rigs.rig import Rig  # noqa: PLC0415 - the script first puts the repository on the path

    return "\n".join([HEAD, *_sections(Rig)])


def _sections(root: Model) -> Iterator[str]:
    """Return the sections in the order of the keys in a file, each child section after its parent."""
    schema = root.model_json_schema(by_alias=False)
    definitions: dict[str, Schema] = schema["$defs"]
    places: dict[str, str] = {root.__name__: "The file"}
    classes = {one.__name__: one for one in _subclasses(BaseModel)}
    _find_places(schema, "", definitions, places)
    shared = _shared(schema, definitions)
    for name, place in places.items():
        model, own = classes[name], definitions.get(name, schema)
        common = shared.get(name)
        yield _section(place, model, own, common, places)


def _find_places(schema: Schema, path: str, definitions: dict[str, Schema], places: dict[str, str]) -> None:
    """Name each mapping by the path of its first use; members of a union by their kind."""
    for key, given in schema["properties"].items():
        here = f"{path}.{key}" if path else key
        references = _references(given)
        for name in references:
            if name in places or name == "Line":
                continue
            keys = definitions[name]["properties"]
            chosen = [keys[one]["const"] for one in _CHOOSERS if one in keys]
            where = here.replace("gauges.g1", "gauges.g1 to g8")  # all belong to one union, first found in g1
            places[name] = f"{where}: {chosen[0]}" if len(references) > 1 and chosen else where
            _find_places(definitions[name], here, definitions, places)


def _references(given: Schema) -> list[str]:
    """Return the mappings that a value may be or contain, in order."""
    if "$ref" in given:
        return [given["$ref"].rpartition("/")[2]]
    below = [*given.get("anyOf", ()), *given.get("oneOf", ()), *([given["items"]] if "items" in given else ())]
    return [name for one in below for name in _references(one)]


def _shared(schema: Schema, definitions: dict[str, Schema]) -> dict[str, Shared]:
    """Return for each further member of a union the first member, and the keys they share with the same meaning."""
    found: dict[str, Shared] = {}
    for mapping in (schema, *definitions.values()):
        for given in mapping["properties"].values():
            members = _references(given)
            if len(members) < 3:
                continue
            kept = [definitions[name]["properties"] for name in members]
            alike = {key for key in kept[0] if all(key in one and one[key] == kept[0][key] for one in kept)}
            found |= dict.fromkeys(members[1:], Shared(members[0], frozenset(alike)))
    return found


def _subclasses(model: Model) -> Iterator[Model]:
    for one in model.__subclasses__():
        yield one
        yield from _subclasses(one)


def _section(place: str, model: Model, schema: Schema, common: Shared | None, places: dict[str, str]) -> str:
    described = " ".join((inspect.getdoc(model) or "").split())
    docs = _docstrings(model)
    items = [
        f"- `{key}`: {_kind(given, places)}{_default(model.model_fields[key])}. {docs.get(key, '')}".rstrip()
        for key, given in schema["properties"].items()
        if key not in _CHOOSERS and not (common and key in common.keys)
    ]
    first = places[common.first] if common else ""
    listed = [f"`{key}`" for key in schema["properties"] if common and key in common.keys]
    also = f"{', '.join(listed)}: as in [{first}](#{_anchor(first)})." if listed else ""
    title = f"### {place}" if "." in place else f"## {place}"
    return "\n\n".join(part for part in (title, described, also, "\n".join(items)) if part) + "\n"


def _docstrings(model: Model) -> dict[str, str]:
    """Return the docstring of each key in the schema, including base classes."""
    found: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if not owner.__module__.startswith("rigs"):
            continue
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(tree, ast.ClassDef)
        for one, after in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and isinstance(after, ast.Expr):
                text = ast.literal_eval(after.value) if isinstance(after.value, ast.Constant) else ""
                found[one.target.id] = " ".join(str(text).split())
    return found


def _kind(given: Schema, places: dict[str, str]) -> str:
    """Describe the type of a value."""
    choices = [one for one in (*given.get("anyOf", ()), *given.get("oneOf", ())) if one.get("type") != "null"]
    named = given.get("enum", [given["const"]] if "const" in given else [])
    if "$ref" in given:
        return _mapping(_references(given)[0], places)
    if len(choices) > 2 and all("$ref" in one for one in choices):
        return "one of the kinds below"
    if choices or named:
        return " or ".join(dict.fromkeys(_kind(one, places) for one in choices)) or ", ".join(f"`{k}`" for k in named)
    return _list(given, places) if given["type"] == "array" else _plain(given, places)


def _plain(given: Schema, places: dict[str, str]) -> str:
    if given["type"] == "object":
        return f"mapping of names to {_kind(given['additionalProperties'], places)}"
    bounds = [words.format(given[key]) for key, words in _BOUNDS.items() if key in given]
    return " ".join(["date" if given.get("format") == "date" else _KINDS[given["type"]], *bounds])


def _list(given: Schema, places: dict[str, str]) -> str:
    if "prefixItems" in given:
        kinds = list(dict.fromkeys(_kind(one, places) for one in given["prefixItems"]))
        return f"list of {len(given['prefixItems'])}: {', '.join(kinds)}"
    exactly = given.get("minItems") if given.get("minItems") == given.get("maxItems") else None
    return f"list{'' if exactly is None else f' of {exactly}'}, each: {_kind(given['items'], places)}"


def _mapping(name: str, places: dict[str, str]) -> str:
    linked = f"[mapping](#{_anchor(places[name])})" if name in places else "mapping"
    return _WRITTEN.get(name, "{}").format(linked)


def _anchor(title: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    kept = "".join(one for one in title.lower() if one.isalnum() or one in " -_")
    return kept.replace(" ", "-")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return " (**required**)"
    value = field.get_default(call_default_factory=True)
    if value in (None, PydanticUndefined, "", (), {}):
        return ""
    if isinstance(value, BaseModel):
        written = str(value) if type(value).__str__ is not BaseModel.__str__ else ""
    elif isinstance(value, tuple):
        written = f"[{', '.join(map(_plainly, value))}]"
    else:
        written = _plainly(value)
    return f", default `{written}`" if written and len(written) <= _LONGEST_DEFAULT else ""


def _plainly(value: object) -> str:
    """Format a value as YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.support.markdown import wrapped

    sys.stdout.write(wrapped(page()))
