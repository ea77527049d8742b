"""Description of the mistakes in a rig file, each with line, place and the nearest known name.

pydantic finds the mistakes. The YAML node tree of the same text gives the lines.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.plugins import BROKEN

_MOST_TOLD = 100
_CLOSE = 0.5
"""Minimum similarity of a name and a known name (ratio of difflib) for a suggestion."""
_BRIEF = 60
_LONG = re.compile(rf"'[^']{{{_BRIEF},}}'")
Place = tuple[int | str, ...]
_PLAIN = {
    "missing": "missing; add it",
    "interface": "is missing the key `interface`; add it; rig interfaces lists the values",
    "effect": "is missing the key `effect`; add it",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "name": "may contain only a–z, 0–9, - and _, and begins with a letter or digit",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_parsing_size": "must be a whole number of ordinary size",
    "float_type": "must be a number such as 12.5, without quotes or unit",
    "float_parsing": "must be a number such as 12.5, without quotes or unit",
    "finite_number": "must be a finite number",
    "invalid_key": "is not the name of a key; write decimals with a point: 12.5",
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be a text, a number in quotes",
    "tuple_type": "must be a list in brackets, such as [1, 2, 3]",
    "list_type": "must be a list in brackets, such as [1, 2, 3]",
    "dict_type": "must be a mapping of keys to values",
    "date_type": "must be a date such as 2026-11-29",
    "date_from_datetime_parsing": "must be a date such as 2026-11-29",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_long": "has {actual_length} entries, but takes at most {max_length}",
    "too_short": "has {actual_length} entries, but needs at least {min_length}",
    "string_too_long": "must have at most {max_length} characters",
    "string_too_short": "must have at least {min_length} characters",
    "string_pattern_mismatch": "must have the form {pattern}",
}
"""Messages by the type of a pydantic error, with its context."""


@dataclass(frozen=True)
class Problem:
    line: int
    place: str
    message: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.place}: {self.message}" if self.place else f"line {self.line}: {self.message}"


class RigFileError(FileError):
    def __init__(self, path: str, problems: list[Problem]) -> None:
        count = "1 mistake" if len(problems) == 1 else f"{len(problems)} mistakes"
        listed = " | ".join(map(str, problems))
        super().__init__(path, f"{count}: {listed}", "correct the file", code="rig_file.invalid")
        self.problems = problems

    def lines(self) -> list[str]:
        return [f"{self.where}, {problem}" for problem in self.problems]

    def to_dict(self) -> dict[str, Any]:
        problems = [{"line": one.line, "place": one.place, "message": one.message} for one in self.problems]
        return {**super().to_dict(), "problems": problems}


def problems_of(
    error: ValidationError, data: Any, root: yaml.Node | None, model: type[BaseModel] = Rig
) -> list[Problem]:
    details = _with_hidden(data, error.errors(include_url=False), model)
    places = [detail["loc"] for detail in details]
    # A list is also `too_short` if an entry is wrong. Only the entry is the mistake.
    details = [
        detail
        for detail in details
        if detail["type"] != "too_short"
        or not any(len(place) > len(detail["loc"]) and place[: len(detail["loc"])] == detail["loc"] for place in places)
    ]
    problems = sorted((_problem(detail, root, model) for detail in details[:_MOST_TOLD]), key=lambda p: p.line)
    if untold := len(details) - len(problems):
        problems.append(Problem(problems[-1].line, "", f"and {untold} more mistakes; correct these first"))
    return problems


def truth_values(data: Any, value: Any, node: yaml.Node | None, place: str = "") -> Iterator[Problem]:
    """Yield a mistake for each true, false or quoted text in the data that became a number."""
    is_quoted = isinstance(data, str) and isinstance(node, yaml.ScalarNode) and node.style in {"'", '"'}
    if is_quoted and isinstance(value, int | float):
        yield Problem(node.start_mark.line + 1 if node else 1, place, f"must be a number without quotes, not {data!r}")
    elif isinstance(data, bool) and not isinstance(value, bool) and isinstance(value, int | float):
        yield Problem(node.start_mark.line + 1 if node else 1, place, f"must be a number, not {str(data).lower()}")
    elif isinstance(data, dict):
        nodes = {key.value: child for key, child in node.value} if isinstance(node, yaml.MappingNode) else {}
        for key, part in data.items():
            made = value.get(key) if isinstance(value, dict) else getattr(value, str(key), None)
            yield from truth_values(part, made, nodes.get(key, node), f"{place}.{key}" if place else str(key))
    elif isinstance(data, list) and isinstance(value, list | tuple) and len(data) == len(value):
        nodes_in = node.value if isinstance(node, yaml.SequenceNode) else [node] * len(data)
        for number, (part, made, child) in enumerate(zip(data, value, nodes_in, strict=True), 1):
            yield from truth_values(part, made, child, f"{place}[{number}]")


def _with_hidden(data: Any, details: list[ErrorDetails], model: type[BaseModel]) -> list[ErrorDetails]:
    misspelt = [detail for detail in details if detail["type"] == "union_tag_invalid"]
    for detail in misspelt:
        tag, tags, key = _tag_error(detail)
        nearest = difflib.get_close_matches(tag, tags, n=1, cutoff=_CLOSE)
        data = _with(data, detail["loc"], key, nearest[0]) if nearest else data
    try:
        model.model_validate(data)
    except ValidationError as error:
        seen = error.errors(include_url=False)
        return misspelt + [detail for detail in seen if detail["type"] != "union_tag_invalid"]
    return misspelt


def _tag_error(detail: ErrorDetails) -> tuple[str, list[str], str]:
    context = detail["ctx"]
    tags = [name.strip().strip("'") for name in context["expected_tags"].split(",")]
    return str(context["tag"]), tags, context["discriminator"].strip("'")


def _with(data: Any, loc: Place, key: str, value: str) -> Any:
    copy = data.copy()
    if loc:
        copy[loc[0]] = _with(data[loc[0]], loc[1:], key, value)
    else:
        copy[key] = value
    return copy


def _problem(detail: ErrorDetails, root: yaml.Node | None, model: type[BaseModel]) -> Problem:
    """Convert a pydantic error. Union tags are dropped from its location, because the file has no such keys."""
    place: list[int | str] = []
    node = root
    for position, step in enumerate(detail["loc"]):
        child: yaml.Node | None = None
        if isinstance(node, yaml.MappingNode):
            child = next((value for key, value in node.value if key.value == step), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
            child = node.value[step]
        if child is not None:
            node = child
        if child is not None or position == len(detail["loc"]) - 1:
            place.append(step)
    line = node.start_mark.line + 1 if node is not None else 1
    text = ""
    for step in place:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{_name(step)}" if text else _name(step)
    return Problem(line, text, plain_message(detail, model, tuple(place)))


def _name(key: str) -> str:
    return key if key.isprintable() and len(key) <= _BRIEF else f"{key[:_BRIEF]!r}…"


def plain_message(detail: ErrorDetails, model: type[BaseModel], place: Place = ()) -> str:
    kind, value = detail["type"], detail["input"]
    if isinstance(value, bool) and kind.startswith(("greater_than", "less_than")):
        return f"must be a number, not {str(value).lower()}"
    if kind == "extra_forbidden":
        return f"unknown key{_nearest(str(place[-1]), _keys_at(detail['loc'][:-1], model))}"
    if kind == "union_tag_invalid":
        tag, choices, _ = _tag_error(detail)
        return BROKEN.get(tag) or f"{_short(tag)} is unknown{_nearest(tag, choices)}"
    if kind == "literal_error":
        choices = [name.strip().strip("'") for name in detail["ctx"]["expected"].replace(" or ", ", ").split(",")]
        tag = _short(value).strip("'")
        return f"{tag!r} is unknown{_nearest(tag, choices)}"
    if kind == "string_pattern_mismatch" and place == ("name",):
        kind = "name"
    if kind == "union_tag_not_found":
        kind = detail["ctx"]["discriminator"].strip("'")
    known = _PLAIN.get(kind)
    message = known.format(**detail.get("ctx", {})) if known else detail["msg"].removeprefix("Value error, ")
    message = _LONG.sub(lambda long: f"{long[0][:_BRIEF]}…'", message)
    if not isinstance(value, int | float | str) or kind in ("too_short", "too_long"):
        return message
    written = re.escape(_short(value).strip("'"))
    is_said = re.search(rf"(?<![\w.]){written}(?![\w.])", message)  # 0.001 does not contain 0
    return message if is_said else f"{message}, not {_short(value)}"


def _short(value: object) -> str:
    if isinstance(value, int) and value.bit_length() > 1000:
        return "a number with hundreds of digits"
    text = repr(value)
    return text if len(text) <= _BRIEF else f"{text[:_BRIEF]}…"


def _nearest(name: str, names: list[str]) -> str:
    close = difflib.get_close_matches(name, names, n=1, cutoff=_CLOSE)
    return f"; did you mean {close[0]}?" if close else f"; available: {', '.join(sorted(names))}"


def _keys_at(loc: Place, model: type[BaseModel]) -> list[str]:
    annotation: Any = model
    for step in loc:
        models = _models(annotation)
        tagged = {
            str(get_args(model.model_fields[key].annotation)[0]): model
            for model in models
            for key in ("interface", "effect")
            if key in model.model_fields
        }
        if step in tagged:
            annotation = tagged[str(step)]
        elif isinstance(step, str):
            fields = [model.model_fields[step] for model in models if step in model.model_fields]
            annotation = fields[0].annotation if fields else None
    return sorted({key for model in _models(annotation) for key in model.model_fields})


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models(argument)]
