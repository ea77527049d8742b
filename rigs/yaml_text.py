"""Parsing and writing of YAML text by the safe loader. Repeated keys, alias bombs and endless numbers are refused."""

from __future__ import annotations

import re
from typing import Any

import yaml

from rigs.problems import Problem, RigFileError
from rigs.text import is_too_small

_MOST_PARTS = 500_000
_LONGEST_NUMBER = 64
"""Maximum length in characters.

A double has 17 digits. PyYAML reads !!int 1:30 as 90, and takes a minute for a megabyte of it.
"""
_LARGEST_WHOLE = 2.0**53
"""Value above which every double is an integer with more digits than any user would write."""
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_WITH_EXPONENT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")
_UNREADABLE = (ValueError, TypeError, AttributeError, LookupError, ArithmeticError)
"""Exceptions of PyYAML for values with explicit tags."""


def _as_in_1_2(tag: str, pattern: re.Pattern[str]) -> re.Pattern[str]:
    """Restrict the pattern of a tag to YAML 1.2, which does not read `yes` as true, `1:30` as 90 or `017` as 15."""
    match tag:
        case "tag:yaml.org,2002:bool":
            return re.compile(r"(?:true|True|TRUE|false|False|FALSE)$")
        case "tag:yaml.org,2002:int" | "tag:yaml.org,2002:float":
            return re.compile(rf"(?!.*:|[-+]?0[0-9_]){pattern.pattern}", pattern.flags)
    return pattern


class _Loader(yaml.SafeLoader):
    """Safe loader of PyYAML with YAML 1.2 scalars.

    In YAML 1.1 a length of `yes` would be 1 mm, and `1:10` would be 70 mm. The loader in C takes a quarter of the time,
    but deeply nested text ends the process with a segmentation fault, and its messages name other places.
    """

    yaml_implicit_resolvers = {  # noqa: RUF012 - PyYAML's own name, which its stubs have as that of an instance
        first: [(tag, _as_in_1_2(tag, pattern)) for tag, pattern in resolvers]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


def read_yaml(text: str, where: str) -> tuple[yaml.Node | None, Any]:
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            return None, None
        _refuse_repeats_and_long_numbers(root, where)
        if _parts(root, {}) > _MOST_PARTS:
            problem = f"aliases (*name) expand to more than {_MOST_PARTS} parts; write the values out"
            raise RigFileError(where, [Problem(1, "", problem)])
        return root, loader.construct_document(root)
    except yaml.YAMLError as error:
        raise RigFileError(where, [_yaml_problem(error)]) from None
    except RecursionError:
        raise RigFileError(where, [Problem(1, "", "not readable as YAML: nested too deeply")]) from None
    except _UNREADABLE as error:
        raise RigFileError(where, [Problem(1, "", f"not readable as YAML: {error}")]) from None


_IN_WORDS = {
    "found character '\\t'": "a tab; indent with spaces",
    "could not find expected ':'": "a key without a value; write a colon and a space after the key",
    "mapping values are not allowed": "an unexpected colon; indent this line as its neighbours, write a space after "
    "the colon of the line before, or put a text with a colon in quotes",
    "expected <block end>": "the indentation is wrong; begin all keys of a section in the same column",
    "expected ',' or ']'": "a list is not closed; write commas between the entries, and ] at the end",
    "expected ',' or '}'": "a mapping is not closed; write commas between the entries, and } at the end",
    "found unexpected end of stream": "a quote is not closed; add the second quote",
}
"""Descriptions of problems that PyYAML reports, by the beginning of its message."""


def _yaml_problem(error: yaml.YAMLError) -> Problem:
    mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error).splitlines()[0]
    words = next((words for begin, words in _IN_WORDS.items() if problem.startswith(begin)), problem)
    if problem.startswith("could not find expected"):
        mark = getattr(error, "context_mark", None) or mark  # PyYAML notices a missing colon at a later key
    return Problem(mark.line + 1 if mark else 1, "", f"not YAML: {words}")


def nodes_of(text: str) -> yaml.Node | None:
    return _Loader(text).get_single_node()


def data_of(text: str) -> Any:
    return _Loader(text).get_single_data()


def flow(value: Any) -> str:
    """Format a value as single-line YAML. Integers have no decimal point."""
    whole = _with_whole_numbers(value)
    text: str = yaml.safe_dump(whole, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.strip().removesuffix("\n...").strip()


def _with_whole_numbers(value: Any) -> Any:
    match value:
        case float():  # including those of numpy, which PyYAML rejects
            return int(value) if value.is_integer() and abs(value) < _LARGEST_WHOLE else float(value)
        case dict():
            return {key: _with_whole_numbers(item) for key, item in value.items()}
        case list() | tuple():
            return [_with_whole_numbers(item) for item in value]
    return value


def _is_plain_number(node: yaml.Node) -> bool:
    """Whether a node is a number with an exponent, without quotes. YAML 1.1 reads one without a point as a text."""
    return isinstance(node, yaml.ScalarNode) and node.style is None and bool(_WITH_EXPONENT.fullmatch(node.value))


def _refuse_repeats_and_long_numbers(root: yaml.Node, where: str) -> None:
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
        elif _is_plain_number(node) and is_too_small(node.value):
            problem = f"{node.value} is too small for a number; write 0 if that is meant"
            problems.append(Problem(node.start_mark.line + 1, "", problem))

    walk(root)
    if problems:
        raise RigFileError(where, problems)


def _parts(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Number of parts of a node with aliases expanded: a few lines of nested aliases make billions."""
    if id(node) not in sizes:
        sizes[id(node)] = _MOST_PARTS + 1  # limit for a node that contains itself
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        pairs = isinstance(node, yaml.MappingNode)
        sizes[id(node)] = 1 + sum(_parts(part, sizes) for entry in inner for part in (entry if pairs else (entry,)))
    return sizes[id(node)]
