"""A rig file with some values changed: the text as it was, comments and all, with new values in their places."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import yaml

from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError
from rigs.rig import Rig

Keys = tuple[str, ...]


def with_values(text: str, values: Mapping[Keys, Any], wanted: Rig, where: str) -> str:
    """Return the text of a rig file with values at paths of keys, checked to be the rig that is wanted. Raises
    FileError where the text cannot be changed so, for an alias for example."""
    for keys, value in values.items():
        text = _with_value(text, keys, value)
    with suppress(RigFileError):
        if parse(text, where) == wanted:
            return text
    raise FileError(where, "shares values by YAML aliases that would have to differ", "write them out in the file")


def _with_value(text: str, keys: Keys, value: Any) -> str:
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(node, yaml.MappingNode)  # noqa: S101 - the text of a rig that was loaded
    for depth, key in enumerate(keys):
        known = {one.value: below for one, below in node.value}
        if key not in known:
            return _with_key(text, node, key, _nested(keys[depth + 1 :], value))
        if not isinstance(known[key], yaml.MappingNode):
            return _with_text(text, known[key], _flow(value))
        node = known[key]
    return _with_text(text, node, _flow(value))


def _with_text(text: str, node: yaml.Node, new: str) -> str:
    begin, end = node.start_mark.index, node.end_mark.index
    # A list written line by line ends where the next key begins.
    space = text[begin:end][len(text[begin:end].rstrip()) :]
    return text[:begin] + new + space + text[end:]


def _with_key(text: str, node: yaml.MappingNode, key: str, value: Any) -> str:
    """Return the text with a key that a mapping did not have, before its first one."""
    at = node.value[0][0].start_mark
    after = ", " if node.flow_style else "\n" + " " * at.column
    return f"{text[: at.index]}{key}: {_flow(value)}{after}{text[at.index :]}"


def _nested(keys: Keys, value: Any) -> Any:
    for key in reversed(keys):
        value = {key: value}
    return value


def _flow(value: Any) -> str:
    flow: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return flow.removesuffix("\n").removesuffix("\n...")
