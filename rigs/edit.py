"""A rig file with other values of a test: the text as it was, comments and all, and only these values changed.

YAML's nodes say where in the text each value stands. Numbers are replaced one by one in their places, and keys that are
missing come first in their mapping, whichever style it is written in. What comes of it is read again and held against
what was asked for, so that a style in which one place is used twice (anchors) is refused instead of half changed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import yaml
from pydantic import ValidationError

from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError, problems_of
from rigs.rig import Rig

Values = Mapping[str, float | Sequence[float]]
"""Keys of a test with their numbers, in the units of the file."""
_Edit = tuple[int, int, str]
"""Where a piece of the text begins and ends, and what takes its place."""


def with_test(text: str, test: Literal["circle", "hemisphere"], values: Values, where: str) -> str:
    """The text of a rig file with other values in a test, which is added if it is missing.

    Raises RigFileError where a value is beyond its bounds, FileError where the text cannot be changed in place."""
    wanted = _wanted(text, test, values, where)
    edited = text
    for begin, end, piece in sorted(_edits(text, test, values), reverse=True):
        edited = edited[:begin] + piece + edited[end:]
    try:
        reached = parse(edited, where)
    except RigFileError:
        reached = None
    if reached != wanted:
        what = f"tests.{test} is written in a way that cannot be changed in place (an anchor, or an unusual layout)"
        raise FileError(where, what, "run the command without --write, and paste the block that it prints")
    return edited


def block_of(test: str, values: Values, indent: int = 0) -> str:
    """A test with its values as lines of a rig file, each line ended, indented by so many spaces."""
    lines = [f"{test}:", *(f"  {key}: {_written(value)}" for key, value in values.items())]
    return "".join(f"{' ' * indent}{line}\n" for line in lines)


def _wanted(text: str, test: str, values: Values, where: str) -> Rig:
    """The rig that the new text must stand for."""
    data = yaml.safe_load(text)
    tests = data.get("tests") or {}
    # The numbers as they will be read.
    own = {key: yaml.safe_load(_written(value)) for key, value in values.items()}
    data["tests"] = {**tests, test: {**(tests.get(test) or {}), **own}}
    try:
        return Rig.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, None)) from None


def _edits(text: str, test: str, values: Values) -> list[_Edit]:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    tests = _child(root, "tests")
    if not isinstance(tests, yaml.MappingNode):
        gap = "" if text.endswith("\n") else "\n"
        return [(len(text), len(text), f"{gap}\ntests:\n{block_of(test, values, 2)}")]
    block = _child(tests, test)
    if block is None:
        return [_added(tests, test, values)]
    if not isinstance(block, yaml.MappingNode):  # null
        gap = " " if block.start_mark.index == block.end_mark.index else ""
        return [(block.start_mark.index, block.end_mark.index, gap + _flow(values))]
    there = {key: _child(block, key) for key in values}
    missing = {key: value for key, value in values.items() if there[key] is None}
    edits = [_put_first(block, [f"{key}: {_written(value)}" for key, value in missing.items()])] if missing else []
    for key, node in there.items():
        if node is not None:
            edits += _replaced(node, values[key])
    return edits


def _added(tests: yaml.MappingNode, test: str, values: Values) -> _Edit:
    """A test that was not there, as the first of them."""
    if tests.flow_style:
        return _put_first(tests, [f"{test}: {_flow(values)}"])
    column = tests.start_mark.column
    return _put_first(tests, block_of(test, values, column).strip().split("\n" + " " * column))


def _put_first(mapping: yaml.MappingNode, entries: Sequence[str]) -> _Edit:
    """Entries before all others of a mapping."""
    start = mapping.start_mark
    if mapping.flow_style:
        return start.index + 1, start.index + 1, "".join(f"{entry}, " for entry in entries)
    return start.index, start.index, "".join(f"{entry}\n{' ' * start.column}" for entry in entries)


def _replaced(node: yaml.Node, value: float | Sequence[float]) -> list[_Edit]:
    """Another number, or other numbers, in the place of a value."""
    if isinstance(node, yaml.SequenceNode) and isinstance(value, Sequence) and len(node.value) == len(value):
        return [edit for child, part in zip(node.value, value, strict=True) for edit in _replaced(child, part)]
    return [(node.start_mark.index, node.end_mark.index, _written(value))]


def _child(node: yaml.Node | None, key: str) -> yaml.Node | None:
    if not isinstance(node, yaml.MappingNode):
        return None
    return next((value for name, value in node.value if name.value == key), None)


def _flow(values: Values) -> str:
    return "{" + ", ".join(f"{key}: {_written(value)}" for key, value in values.items()) + "}"


def _written(value: float | Sequence[float]) -> str:
    """A number, or several in brackets, as YAML reads them back."""
    if isinstance(value, Sequence):
        return f"[{', '.join(_written(part) for part in value)}]"
    return f"{value:.10g}"
