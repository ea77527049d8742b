"""Edit values and effects of a rig file in place, with all other text and comments preserved.

The result is parsed and compared with the request, so text that several places share (anchors) is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Any, Literal

import yaml
from pydantic import ValidationError

from rigs.calibration import CalibrationFile
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError, problems_of
from rigs.rig import Rig
from rigs.yaml_text import data_of, flow, nodes_of

Keys = tuple[str, ...]
Value = float | str | Sequence[float]
Values = Mapping[str, float | Sequence[float]]
"""Keys of a test with the numbers, in file units."""
_Edit = tuple[int, int, str]


def with_values(
    text: str, values: Mapping[Keys, Value], expected: Rig, where: str, remedy: str = "write the values out in the file"
) -> str:
    """Text of a rig file with changed values. Raises FileError with this remedy if it cannot be changed in place."""
    edited = _edited(text, values)
    try:
        reached = parse(edited, where)
    except RigFileError:
        reached = None
    if reached != expected:
        raise FileError(
            where,
            "uses a YAML anchor or a layout that cannot be edited automatically",
            remedy,
            code="rig_file.invalid",
        )
    return edited


def _edited(text: str, values: Mapping[Keys, Value]) -> str:
    for parent in dict.fromkeys(keys[:-1] for keys in values):
        changes = {keys[-1]: value for keys, value in values.items() if keys[:-1] == parent}
        for begin, end, piece in sorted(_edits(text, parent, changes), reverse=True):
            text = text[:begin] + piece + text[end:]
    return text


def with_test(text: str, test: Literal["circle", "hemisphere"], values: Values, where: str) -> str:
    rounded = {key: _rounded(value) for key, value in values.items()}
    remedy = "run the command without --write, and paste the printed block"
    changes: dict[Keys, Value] = {("tests", test, key): value for key, value in rounded.items()}
    data = data_of(text)
    tests = data.get("tests") or {}
    data["tests"] = {**tests, test: {**(tests.get(test) or {}), **rounded}}
    try:
        expected = Rig.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, None)) from None
    return with_values(text, changes, expected, where, remedy)


def block_of(test: str, values: Values, indent: int = 0) -> str:
    rounded = {key: _rounded(value) for key, value in values.items()}
    return "".join(f"{' ' * indent}{line}\n" for line in _block((test,), rounded))


def _edits(text: str, parent: Keys, values: Mapping[str, Value]) -> list[_Edit]:
    root = nodes_of(text)
    assert isinstance(root, yaml.MappingNode)  # noqa: S101 - the text of a rig that was loaded
    node = root
    for depth, key in enumerate(parent):
        below = _child(node, key)
        if below is None and node is root and not node.flow_style:  # a new branch at the end of the file
            gap = "\n" if text.endswith("\n") else "\n\n"
            branch = "".join(f"{line}\n" for line in _block(parent[depth:], values))
            return [(len(text), len(text), gap + branch)]
        if below is None:  # a new branch at the start of the mapping
            in_one_line = [f"{key}: {flow(_nested(parent[depth + 1 :], values))}"]
            return [_put_first(node, in_one_line if node.flow_style else _block(parent[depth:], values))]
        if not isinstance(below, yaml.MappingNode):  # null
            gap = " " if below.start_mark.index == below.end_mark.index else ""
            return [(below.start_mark.index, below.end_mark.index, gap + flow(_nested(parent[depth + 1 :], values)))]
        node = below
    nodes = {key: _child(node, key) for key in values}
    missing = [f"{key}: {flow(values[key])}" for key, child in nodes.items() if child is None]
    edits = [_put_first(node, missing)] if missing else []
    for key, child in nodes.items():
        if child is not None:
            edits += _replaced(child, values[key])
    return edits


def _block(keys: Keys, values: Mapping[str, Value]) -> list[str]:
    above = [f"{'  ' * depth}{key}:" for depth, key in enumerate(keys)]
    return [*above, *(f"{'  ' * len(keys)}{key}: {flow(value)}" for key, value in values.items())]


def _put_first(mapping: yaml.MappingNode, entries: Sequence[str]) -> _Edit:
    start = mapping.start_mark
    if mapping.flow_style:
        return start.index + 1, start.index + 1, "".join(f"{entry}, " for entry in entries)
    return start.index, start.index, "".join(f"{entry}\n{' ' * start.column}" for entry in entries)


def _replaced(node: yaml.Node, value: Value) -> list[_Edit]:
    if (
        isinstance(node, yaml.SequenceNode)
        and not isinstance(value, float | int | str)
        and len(node.value) == len(value)
    ):
        return [edit for child, part in zip(node.value, value, strict=True) for edit in _replaced(child, part)]
    return [(node.start_mark.index, node.end_mark.index, flow(value))]


def _child(node: yaml.Node | None, key: str) -> yaml.Node | None:
    if not isinstance(node, yaml.MappingNode):
        return None
    return next((value for name, value in node.value if name.value == key), None)


def _nested(keys: Keys, values: Mapping[str, Value]) -> Mapping[str, Any]:
    return reduce(lambda inner, key: {key: inner}, reversed(keys), values)


def _rounded(value: float | Sequence[float]) -> float | list[float]:
    return [float(f"{part:.10g}") for part in value] if isinstance(value, Sequence) else float(f"{value:.10g}")


def extended(text: str, effects: Sequence[Effect], where: str, calibration: CalibrationFile | None = None) -> str:
    """Text of a rig file with added effects, and optionally a new calibration.

    Raises RigFileError if the result is invalid.
    """
    grown = _with_effects(text, effects) if effects else text
    if calibration:
        grown = _edited(grown, {("calibration", key): value for key, value in calibration.model_dump().items()})
    parse(grown, where)
    return grown


def _with_effects(text: str, effects: Sequence[Effect]) -> str:
    items = [
        _dumped(effect.model_dump(mode="json", exclude_defaults=True) | {"effect": effect.effect}) for effect in effects
    ]
    root = nodes_of(text)
    assert isinstance(root, yaml.MappingNode)  # noqa: S101 - the text of a rig that was loaded
    entries = [(key, value) for key, value in root.value if key.value == "effects"]
    lines = text.rstrip("\n").split("\n")
    if (
        entries
        and isinstance(entries[0][1], yaml.SequenceNode)
        and entries[0][1].value
        and not entries[0][1].flow_style
    ):
        last = entries[0][1].value[-1]
        at = last.end_mark.line + (last.end_mark.column > 0)
        indent = " " * entries[0][1].start_mark.column
        lines[at:at] = [f"{indent}- {item}" for item in items]
    else:
        if entries:
            first, end = entries[0][0].start_mark.line, entries[0][1].end_mark.line
            items = [_dumped(entry) for entry in data_of(text)["effects"] or []] + items
            del lines[first : end + 1]
        lines += ["", "effects:", *(f"  - {item}" for item in items)]
    return "\n".join(lines) + "\n"


def _dumped(fields: dict[str, object]) -> str:
    ordered = {"effect": fields["effect"], **fields}
    if "found" in ordered:
        ordered["found"] = ordered.pop("found")
    return flow(ordered)
