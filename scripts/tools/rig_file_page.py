"""Generate docs/rig-file-reference.md from the schema: `scripts/dev rig_file_page > docs/rig-file-reference.md`.

Each mapping of a rig file has a section, named by the place of its first use, with the type, default and docstring of
each key. Nothing is listed twice: all members of a union (every gauge, every effect) refer to a section of their common
keys, similar mappings refer to the first of them, and keys with the same description share an item.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

HEAD = """\
# Every key of a rig file

[The rig file](rig-file.md) explains the keys with examples. Unlisted keys and values beyond the bounds are refused. In
a heading, the word after a colon is the value of `interface` or `effect` that selects this kind of mapping. Names state
the unit; a *length* is a number of mm within ±100000, and an *angle* a number of degrees within ±1440.

This page is generated from the schema: `scripts/dev rig_file_page > docs/rig-file-reference.md`.
"""
_BOUNDS = {
    "minimum": "{:.7g}",
    "exclusiveMinimum": "above {:.7g}",
    "maximum": "to {:.7g}",
    "exclusiveMaximum": "below {:.7g}",
}
_NAMED_RANGES = {"-100000 to 100000": "length", "-1440 to 1440": "angle"}
"""Bounds of most keys; the head of the page defines the names."""
_KINDS = {"number": "number", "integer": "integer", "string": "text", "boolean": "`true` or `false`"}
_WRITTEN = {"Line": "line settings", "Limit": "number, which is `fail`, or {}"}
"""Mappings with a special notation in a rig file, by class; {} is the mapping."""
_CHOOSERS = ("interface", "effect")
"""Keys whose value selects the kind of a mapping."""
_LONGEST_DEFAULT = 40
_SOURCE = "Healthy value"
"""Beginning of the origin of a prior size in the docstring of an effect, for readers of the code."""
_TABLE_HEAD = """\
A number that is not required is 0 unless a default is stated.{}

| kind | meaning | keys |
| --- | --- | --- |"""
_FREQUENT = 4
"""Number of equal keys in a table from which they are described once."""
_SIMILAR = 3
"""Number of equal keys from which a section refers to an earlier one instead of listing them."""

Model = type[BaseModel]
Schema = dict[str, Any]


@dataclass(frozen=True)
class Key:
    """A key of a mapping: type, with default, and docstring."""

    kind: str
    text: str

    def listed(self, names: str, *, without_text: bool = False) -> str:
        return f"- {names}: {self.kind}. {'' if without_text else self.text}".rstrip()


@dataclass
class Page:
    """Sections written so far, to which later ones refer."""

    places: dict[str, str]
    """Title of each mapping, by the name of its class."""
    unions: dict[str, str]
    """Title of the common keys of the union to which a class belongs."""
    common: dict[str, dict[str, Key]] = field(default_factory=dict)
    """Common keys by that title."""
    written: dict[str, dict[str, Key]] = field(default_factory=dict)
    """Keys by the title of their section."""
    tables: dict[str, str] = field(default_factory=dict)
    """Tables of the members of unions whose keys need no description, by the title of the common keys."""
    in_tables: set[str] = field(default_factory=set)
    """Classes in these tables."""


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
    keys = {name: _keys(classes[name], definitions.get(name, schema), places) for name in places}
    found = Page(places, {})
    for members in _unions(schema, definitions):
        title = f"{places[members[0]].partition(':')[0]}: all kinds"
        common = found.common[title] = _common([keys[name] for name in members])
        found.unions |= dict.fromkeys(members, title)
        found.in_tables |= (brief := {name for name in members if _is_brief(_own(keys[name], common), common)})
        own = {name: _own(keys[name], common) for name in members if name in brief}
        found.tables[title] = _table({name: (classes[name], own[name]) for name in own}, places) if own else ""
    for name in places:
        title = found.unions.get(name, "")
        if title and title not in found.written:
            found.written[title] = found.common[title]
            yield _text(title, _items(found.common[title], {}), found.tables[title])
        if name not in found.in_tables:
            yield _section(name, classes[name], keys[name], found)


def _keys(model: Model, schema: Schema, places: dict[str, str]) -> dict[str, Key]:
    docs = _docstrings(model)
    return {
        key: Key(_with_default(_kind(given, places), model.model_fields[key]), docs.get(key, "").partition(_SOURCE)[0])
        for key, given in schema["properties"].items()
        if key not in _CHOOSERS
    }


def _unions(schema: Schema, definitions: dict[str, Schema]) -> list[list[str]]:
    """Mappings of which a rig file selects one by `interface` or `effect`."""
    found: list[list[str]] = []
    for mapping in (schema, *definitions.values()):
        for given in mapping["properties"].values():
            members = _references(given)
            if len(members) > 2 and members not in found:
                found.append(members)
    return found


def _common(members: list[dict[str, Key]]) -> dict[str, Key]:
    """Keys that exist in every kind of a union. If kinds describe a key differently, the most frequent one wins."""
    names = [name for name in members[0] if all(name in one for one in members)]
    return {name: Counter(one[name] for one in members).most_common(1)[0][0] for name in names}


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
            where = here.replace("gauges.g1", "gauges")  # all gauges belong to one union, first found in g1
            places[name] = f"{where}: {chosen[0]}" if len(references) > 1 and chosen else where
            _find_places(definitions[name], here, definitions, places)


def _references(given: Schema) -> list[str]:
    """Return the mappings that a value may be or contain, in order."""
    if "$ref" in given:
        return [given["$ref"].rpartition("/")[2]]
    below = [*given.get("anyOf", ()), *given.get("oneOf", ()), *([given["items"]] if "items" in given else ())]
    return [name for one in below for name in _references(one)]


def _subclasses(model: Model) -> Iterator[Model]:
    for one in model.__subclasses__():
        yield one
        yield from _subclasses(one)


def _section(name: str, model: Model, keys: dict[str, Key], page: Page) -> str:
    place = page.places[name]
    common = page.common.get(page.unions.get(name, ""), {})
    own = _own(keys, common)
    also = ""
    if same := _most_similar(own, page.written):
        listed = [key for key in own if page.written[same].get(key) == own[key]]
        also = f"{_names(listed)}: as in [{same}](#{_anchor(same)})."
        own = {key: one for key, one in own.items() if key not in listed}
    page.written[place] = keys
    return _text(place, _described(model), also, _items(own, common))


def _own(keys: dict[str, Key], common: dict[str, Key]) -> dict[str, Key]:
    return {key: one for key, one in keys.items() if common.get(key) != one}


def _is_brief(own: dict[str, Key], common: dict[str, Key]) -> bool:
    return not any(one.text and (key not in common or common[key].text != one.text) for key, one in own.items())


def _described(model: Model) -> str:
    return " ".join((inspect.getdoc(model) or "").split())


def _table(members: dict[str, tuple[Model, dict[str, Key]]], places: dict[str, str]) -> str:
    """A table with a row for each mapping of a union whose keys need no description.

    Keys of the same type in many mappings are described once, before the table.
    """
    counts = Counter((key, _kind_in_table(one)) for _, keys in members.values() for key, one in keys.items())
    frequent = {key: kind for (key, kind), count in counts.items() if count >= _FREQUENT}
    stated = "; ".join(f"`{key}` is {kind}" for key, kind in frequent.items())
    rows = [_row(places[name], model, keys, frequent) for name, (model, keys) in members.items()]
    return "\n".join([_TABLE_HEAD.format(f" Unless stated, {stated}." if stated else ""), *rows])


def _row(place: str, model: Model, keys: dict[str, Key], frequent: dict[str, str]) -> str:
    alike: dict[str, list[str]] = {}
    for key, one in keys.items():
        kind = _kind_in_table(one)
        alike.setdefault("" if frequent.get(key) == kind else f": {kind}", []).append(key)
    cell = "; ".join(f"{_names(same)}{kind}" for kind, same in alike.items())
    return f"| `{place.partition(': ')[2]}` | {_described(model)} | {cell} |"


def _kind_in_table(one: Key) -> str:
    return one.kind.removesuffix(", default `0`")


def _most_similar(keys: dict[str, Key], written: dict[str, dict[str, Key]]) -> str:
    """Title of the earlier section with the most equal keys; empty if only a few are equal."""
    equal = {title: sum(earlier.get(key) == one for key, one in keys.items()) for title, earlier in written.items()}
    title = max(equal, key=equal.__getitem__, default="")
    return title if title and equal[title] >= _SIMILAR else ""


def _items(keys: dict[str, Key], common: dict[str, Key]) -> str:
    """A list item for each description, with all keys that it describes."""
    alike: dict[Key, list[str]] = {}
    for name, one in keys.items():
        alike.setdefault(one, []).append(name)
    return "\n".join(
        one.listed(_names(names), without_text=names[0] in common and common[names[0]].text == one.text)
        for one, names in alike.items()
    )


def _names(keys: list[str]) -> str:
    return ", ".join(f"`{key}`" for key in keys)


def _text(title: str, *parts: str) -> str:
    """A section; empty parts are omitted."""
    heading = f"### {title}" if "." in title else f"## {title}"
    return "\n\n".join(part for part in (heading, *parts) if part) + "\n"


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
    if len(bounds) == 1 and "minimum" in given:
        bounds.insert(0, "from")
    if bounds and given["type"] == "number":
        return _NAMED_RANGES.get(" ".join(bounds), " ".join(bounds))
    return " ".join(["date" if given.get("format") == "date" else _KINDS[given["type"]], *bounds])


def _list(given: Schema, places: dict[str, str]) -> str:
    if "prefixItems" in given:
        kinds = list(dict.fromkeys(_kind(one, places) for one in given["prefixItems"]))
        return f"list of {len(given['prefixItems'])}: {', '.join(kinds)}"
    exactly = given.get("minItems") if given.get("minItems") == given.get("maxItems") else None
    kind = f"list{'' if exactly is None else f' of {exactly}'}: {_kind(given['items'], places)}"
    return kind.replace("list: list", "list of lists")


def _mapping(name: str, places: dict[str, str]) -> str:
    linked = f"[mapping](#{_anchor(places[name])})" if name in places else "mapping"
    return _WRITTEN.get(name, "{}").format(linked)


def _anchor(title: str) -> str:
    """Return the anchor that GitHub gives a heading."""
    kept = "".join(one for one in title.lower() if one.isalnum() or one in " -_")
    return kept.replace(" ", "-")


def _with_default(kind: str, field: FieldInfo) -> str:
    if field.is_required():
        return f"{kind} (**required**)"
    written = _written_default(field)
    if not written or len(written) > _LONGEST_DEFAULT:
        return kind
    if f"`{written}`" in kind:
        return kind.replace(f"`{written}`", f"`{written}` (default)", 1)
    return f"{kind}, default `{written}`"


def _written_default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    if value in (None, PydanticUndefined, "", (), {}):
        return ""
    if isinstance(value, BaseModel):
        return str(value) if type(value).__str__ is not BaseModel.__str__ else ""
    return f"[{', '.join(map(_plainly, value))}]" if isinstance(value, tuple) else _plainly(value)


def _plainly(value: object) -> str:
    """Format a value as YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.support.markdown import wrapped

    sys.stdout.write(wrapped(page()))
