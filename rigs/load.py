"""Reading a rig file: every error at once, each with its line, its place and the nearest known name.

YAML is read with the safe loader only. pydantic finds the errors; the YAML node tree, composed from the
same text, tells the line each of them stands on.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from rigs.errors import FileError
from rigs.rig import Rig

SHIPPED = Path(__file__).parent
_MAX_BYTES = 1_000_000
Place = tuple[int | str, ...]


@dataclass(frozen=True)
class Problem:
    """One mistake in a rig file."""

    line: int
    place: str
    message: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.place}: {self.message}" if self.place else f"line {self.line}: {self.message}"


class RigFileError(FileError):
    """A rig file with mistakes, all of them in `problems`."""

    def __init__(self, path: str, problems: list[Problem]) -> None:
        count = "1 mistake" if len(problems) == 1 else f"{len(problems)} mistakes"
        super().__init__(path, f"{count}: " + " | ".join(map(str, problems)), "mend the file")
        self.problems = problems

    def lines(self) -> list[str]:
        return [f"{self.where}, {problem}" for problem in self.problems]


def find(name: str | Path) -> Path:
    """A rig file by path, or a shipped one by name (`paper-fanuc`). Raises FileError with what is shipped."""
    path = Path(name)
    if path.exists() and not path.is_dir():
        return path
    shipped = {file.stem: file for file in sorted(SHIPPED.glob("*.yaml"))}
    if str(name) in shipped:
        return shipped[str(name)]
    raise FileError(str(name), "no such rig file", f"give a path, or a shipped rig: {', '.join(shipped)}")


def load(name: str | Path) -> tuple[Rig, str]:
    """A rig and the text of its file as it is. Raises FileError or RigFileError."""
    path = find(name)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise FileError(str(path), "larger than 1 MB, which no rig file is", "give the rig file itself")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FileError(str(path), f"not UTF-8 at byte {error.start}", "save it as UTF-8") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "check the path and its permissions") from None
    return parse(text, str(path)), text


def parse(text: str, where: str) -> Rig:
    """A rig from the text of its file; `where` names it in errors. Raises RigFileError."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        if root is not None:
            _refuse_repeats(root, where)
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        what = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise RigFileError(where, [Problem(mark.line + 1 if mark else 1, "", f"not YAML: {what}")]) from None
    except (RecursionError, ValueError) as error:
        raise RigFileError(where, [Problem(1, "", f"not readable as YAML: {error}")]) from None
    try:
        return Rig.model_validate(data)
    except ValidationError as error:
        details = _without_consequences(error.errors(include_url=False))
        problems = [_problem(detail, root) for detail in details]
        raise RigFileError(where, sorted(problems, key=lambda p: p.line)) from None


def _without_consequences(details: list[ErrorDetails]) -> list[ErrorDetails]:
    """A list is `too_short` also because one of its entries is wrong; the entry alone is the mistake."""
    places = [detail["loc"] for detail in details]
    return [
        detail
        for detail in details
        if detail["type"] != "too_short"
        or not any(len(place) > len(detail["loc"]) and place[: len(detail["loc"])] == detail["loc"] for place in places)
    ]


def _refuse_repeats(root: yaml.Node, where: str) -> None:
    """YAML's loader keeps the last of two equal keys without a word; a rig file may not lose one."""
    seen: set[int] = set()
    problems: list[Problem] = []

    def walk(node: yaml.Node) -> None:
        if id(node) in seen:
            return
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            known: set[str] = set()
            for key, value in node.value:
                if key.value in known:
                    problems.append(Problem(key.start_mark.line + 1, str(key.value), "this key stands here twice"))
                if isinstance(key, yaml.ScalarNode):
                    known.add(key.value)
                walk(value)
        elif isinstance(node, yaml.SequenceNode):
            for value in node.value:
                walk(value)

    walk(root)
    if problems:
        raise RigFileError(where, problems)


def _problem(detail: ErrorDetails, root: yaml.Node | None) -> Problem:
    place, node = _locate(detail["loc"], root)
    line = node.start_mark.line + 1 if node is not None else 1
    return Problem(line, _written(place), _message(detail, place))


def _locate(loc: Place, root: yaml.Node | None) -> tuple[Place, yaml.Node | None]:
    """The part of pydantic's location that stands in the file, and its node.

    pydantic puts a union's tag into the location; the file has no key of that name, so it is left out.
    """
    place: list[int | str] = []
    node = root
    for position, step in enumerate(loc):
        child = _child(node, step)
        if child is not None:
            node = child
            place.append(step)
        elif position == len(loc) - 1:
            place.append(step)
    return tuple(place), node


def _child(node: yaml.Node | None, step: int | str) -> yaml.Node | None:
    if isinstance(node, yaml.MappingNode):
        return next((value for key, value in node.value if key.value == step), None)
    if isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
        child: yaml.Node = node.value[step]
        return child
    return None


def _written(place: Place) -> str:
    text = ""
    for step in place:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _message(detail: ErrorDetails, place: Place) -> str:
    kind, given = detail["type"], detail["input"]
    if kind == "extra_forbidden":
        return f"unknown key{_nearest(str(place[-1]), _keys_at(detail['loc'][:-1]))}"
    if kind == "missing":
        return "missing; add it"
    if kind in ("union_tag_invalid", "literal_error"):
        context = detail.get("ctx", {})
        tag = str(context.get("tag", given))
        expected = str(context.get("expected_tags", context.get("expected", "")))
        known = [name.strip().strip("'") for name in expected.replace(" or ", ", ").split(",")]
        return f"{tag!r} is not known{_nearest(tag, known)}"
    if kind == "union_tag_not_found":
        name = str(detail.get("ctx", {}).get("discriminator", "")).strip("'")
        return f"{name} is missing; add it"
    if kind == "model_type":
        return "must be a mapping of keys to values"
    message = detail["msg"].removeprefix("Value error, ")
    shown = given if isinstance(given, int | float | str | bool) else None
    return message if shown is None or str(shown) in message else f"{message}, not {shown!r}"


def _nearest(name: str, known: list[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]}?" if close else f"; known here: {', '.join(sorted(known))}"


def _keys_at(loc: Place) -> list[str]:
    """Keys that the model at a location knows; union tags in the location choose the member."""
    annotation: Any = Rig
    for step in loc:
        models = _models(annotation)
        tagged = [model for model in models if _tag(model) == step]
        if tagged:
            annotation = tagged[0]
        elif isinstance(step, str):
            fields = [model.model_fields[step] for model in models if step in model.model_fields]
            annotation = fields[0].annotation if fields else None
    return sorted({key for model in _models(annotation) for key in model.model_fields})


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models(argument)]


def _tag(model: type[BaseModel]) -> str | None:
    for key in ("interface", "effect"):
        if key in model.model_fields:
            return str(get_args(model.model_fields[key].annotation)[0])
    return None
