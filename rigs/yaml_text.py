"""A rig file's text as YAML. It is read by the safe loader only: no key twice, no bomb of aliases, no number without
end. A value is written in one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

from rigs.problems import Problem, RigFileError

_MOST_PARTS = 500_000
"""Keys and values once every alias is followed; a megabyte written out has no more."""
_LONGEST_NUMBER = 64
"""Characters; a double has 17 digits. PyYAML takes !!int 1:30 for 90, and a minute for a megabyte written so."""
_LARGEST_WHOLE = 2.0**53
"""Every double is whole from here on, and has more digits than anybody wrote."""
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_UNREADABLE = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError)
"""What PyYAML raises beside its own errors, for what stands behind an explicit tag."""


def _as_in_1_2(tag: str, pattern: re.Pattern[str]) -> re.Pattern[str]:
    """Return the pattern of plain values of a tag without those that YAML 1.2 does not read so: `yes` as true, `1:30`
    as 90 and `017` as 15."""
    match tag:
        case "tag:yaml.org,2002:bool":
            return re.compile(r"(?:true|True|TRUE|false|False|FALSE)$")
        case "tag:yaml.org,2002:int" | "tag:yaml.org,2002:float":
            return re.compile(rf"(?!.*:|[-+]?0[0-9_]){pattern.pattern}", pattern.flags)
    return pattern


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader. A length of `yes` would be 1 mm, and one of `1:10` 70 mm, as YAML 1.1 has them."""

    yaml_implicit_resolvers = {  # noqa: RUF012 - PyYAML's own name, which its stubs have as that of an instance
        first: [(tag, _as_in_1_2(tag, pattern)) for tag, pattern in resolvers]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


def read_yaml(text: str, where: str) -> tuple[yaml.Node | None, Any]:
    """The nodes of a text and the data they stand for, read by the safe loader. Raises RigFileError."""
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            return None, None
        _refuse_repeats_and_long_numbers(root, where)
        if _parts(root, {}) > _MOST_PARTS:
            problem = f"aliases (*name) make more than {_MOST_PARTS} parts of it; write out what they stand for"
            raise RigFileError(where, [Problem(1, "", problem)])
        return root, loader.construct_document(root)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise RigFileError(where, [Problem(mark.line + 1 if mark else 1, "", f"not YAML: {problem}")]) from None
    except RecursionError:
        raise RigFileError(where, [Problem(1, "", "not readable as YAML: nested too deeply")]) from None
    except _UNREADABLE as error:
        raise RigFileError(where, [Problem(1, "", f"not readable as YAML: {error}")]) from None


def nodes_of(text: str) -> yaml.Node | None:
    """The nodes of a text that was read before."""
    return _Loader(text).get_single_node()


def data_of(text: str) -> Any:
    """What a text that was read before stands for."""
    return _Loader(text).get_single_data()


def flow(value: Any) -> str:
    """Return a value as YAML in one line, whole numbers without a point."""
    whole = _whole(value)
    text: str = yaml.safe_dump(whole, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.strip().removesuffix("\n...").strip()


def _whole(value: Any) -> Any:
    match value:
        case float():  # numpy's as well, which PyYAML does not take
            return int(value) if value.is_integer() and abs(value) < _LARGEST_WHOLE else float(value)
        case dict():
            return {key: _whole(item) for key, item in value.items()}
        case list() | tuple():
            return [_whole(item) for item in value]
    return value


def _refuse_repeats_and_long_numbers(root: yaml.Node, where: str) -> None:
    """YAML's loader keeps the last of two equal keys without a word; a rig file may not lose one."""
    seen: set[int] = set()
    problems: list[Problem] = []

    def walk(node: yaml.Node) -> None:
        if id(node) in seen:
            return
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            keys: set[str] = set()
            for key, value in node.value:
                walk(key)
                if isinstance(key, yaml.ScalarNode):
                    if key.value in keys:
                        problems.append(Problem(key.start_mark.line + 1, key.value, "this key occurs twice"))
                    keys.add(key.value)
                walk(value)
        elif isinstance(node, yaml.SequenceNode):
            for value in node.value:
                walk(value)
        elif node.tag in _NUMBERS and len(node.value) > _LONGEST_NUMBER:
            problem = f"a number of {len(node.value)} characters; write it with at most {_LONGEST_NUMBER}"
            problems.append(Problem(node.start_mark.line + 1, "", problem))

    walk(root)
    if problems:
        raise RigFileError(where, problems)


def _parts(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Parts that a node stands for, aliases followed: a few lines of aliases of aliases make billions."""
    if id(node) not in sizes:
        sizes[id(node)] = _MOST_PARTS + 1  # until it is counted: what holds itself has no end
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        pairs = isinstance(node, yaml.MappingNode)
        sizes[id(node)] = 1 + sum(_parts(part, sizes) for entry in inner for part in (entry if pairs else (entry,)))
    return sizes[id(node)]
