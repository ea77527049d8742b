"""Values of arithmetic expressions in programs: numbers, names with known values, and the given operators."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping

Operators = Mapping[type[ast.operator] | str, Callable[..., float]]


def tree_of(text: str) -> ast.expr | None:
    """Syntax tree of an expression; None for other text."""
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError):
        return None


def value_of(node: ast.expr, names: Mapping[str, float], operators: Operators) -> float:
    """Value of an expression. Raises KeyError for anything that is not arithmetic with these names."""
    match node:
        case ast.Constant(value) if isinstance(value, int | float):
            return float(value)
        case ast.Name(name):
            return names[name]
        case ast.UnaryOp(ast.USub(), operand):
            return -value_of(operand, names, operators)
        case ast.UnaryOp(ast.UAdd(), operand):
            return value_of(operand, names, operators)
        case ast.BinOp(left, sign, right):
            return operators[type(sign)](value_of(left, names, operators), value_of(right, names, operators))
        case ast.Call(ast.Name(function), [operand], []):
            return operators[function](value_of(operand, names, operators))
    raise KeyError(ast.dump(node))
