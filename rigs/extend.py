"""A rig file with more effects: the text as it was, comments and all, and the new effects at the end of their list."""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from rigs.calibration import CalibrationFile
from rigs.effects import Effect
from rigs.load import parse
from rigs.yaml_text import data_of, flow, nodes_of


def extended(text: str, effects: Sequence[Effect], where: str, calibration: CalibrationFile | None = None) -> str:
    """The text of a rig file with effects added, and with its calibration replaced where one is given. Raises
    RigFileError where the result would not be a valid rig file."""
    grown = _with_effects(text, effects) if effects else text
    if calibration:
        grown = _with_calibration(grown, calibration)
    parse(grown, where)
    return grown


def _with_calibration(text: str, calibration: CalibrationFile) -> str:
    """The text with the key `calibration` at its end, or where it was."""
    root = nodes_of(text)
    assert isinstance(root, yaml.MappingNode)  # noqa: S101 - the text of a rig that was loaded
    lines = text.rstrip("\n").split("\n")
    new = ["calibration:", f"  file: {calibration.file}", f"  sha256: {calibration.sha256}"]
    for key, value in root.value:
        if key.value == "calibration":
            first, end = key.start_mark.line, value.end_mark.line + (value.end_mark.column > 0)
            return "\n".join([*lines[:first], *new, *lines[end:]]) + "\n"
    return "\n".join([*lines, "", *new]) + "\n"


def _with_effects(text: str, effects: Sequence[Effect]) -> str:
    items = [_line(effect) for effect in effects]
    root = nodes_of(text)
    assert isinstance(root, yaml.MappingNode)  # noqa: S101 - the text of a rig that was loaded
    there = [(key, value) for key, value in root.value if key.value == "effects"]
    lines = text.rstrip("\n").split("\n")
    if there and isinstance(there[0][1], yaml.SequenceNode) and there[0][1].value and not there[0][1].flow_style:
        last = there[0][1].value[-1]
        at = last.end_mark.line + (last.end_mark.column > 0)
        indent = " " * there[0][1].start_mark.column
        lines[at:at] = [f"{indent}- {item}" for item in items]
    else:
        if there:
            first, end = there[0][0].start_mark.line, there[0][1].end_mark.line
            items = [_dumped(entry) for entry in data_of(text)["effects"] or []] + items
            del lines[first : end + 1]
        lines += ["", "effects:", *(f"  - {item}" for item in items)]
    return "\n".join(lines) + "\n"


def _line(effect: Effect) -> str:
    return _dumped(effect.model_dump(mode="json", exclude_defaults=True) | {"effect": effect.effect})


def _dumped(fields: dict[str, object]) -> str:
    """One line: first what it is, last where it came from."""
    ordered = {"effect": fields["effect"], **fields}
    if "found" in ordered:
        ordered["found"] = ordered.pop("found")
    return flow(ordered)
