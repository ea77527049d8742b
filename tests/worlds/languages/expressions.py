"""Expressions of URScript, KRL and RAPID as trees: ("number", 1.0), ("name", "a"), ("call", "f", arguments), …"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

Tree = tuple[Any, ...]


class NotUnderstood(Exception):
    """The text is not an expression of the dialect."""


@dataclass
class Tokens:
    """The tokens of a statement: kind and text."""

    items: list[tuple[str, str]]
    at: int = 0

    def peek(self, ahead: int = 0) -> str:
        k = self.at + ahead
        return self.items[k][1] if k < len(self.items) else ""

    def kind(self, ahead: int = 0) -> str:
        k = self.at + ahead
        return self.items[k][0] if k < len(self.items) else "over"

    def take(self, text: str = "") -> str:
        if self.at >= len(self.items) or (text and self.peek() != text):
            raise NotUnderstood(f"{self.peek()!r} for {text!r}")
        self.at += 1
        return self.items[self.at - 1][1]


@dataclass(frozen=True)
class Syntax:
    """Expression syntax of a dialect: token pattern, binary operators by precedence, and aggregates."""

    token: re.Pattern[str]
    operators: tuple[tuple[str, ...], ...]
    unary: tuple[str, ...]
    brackets: str
    """"ur": [ ] lists and indices, p[ ] poses; "krl": { } aggregates, [ ] indices; "rapid": { } indices, [ ]
    aggregates.
    """
    fold: bool = False

    def tokens(self, text: str) -> Tokens:
        items, at = [], 0
        while at < len(text):
            one = self.token.match(text, at)
            if not one or one.end() == at:
                raise NotUnderstood(text[at : at + 20])
            if one.lastgroup:
                word = one[0].upper() if self.fold and one.lastgroup == "name" else one[0]
                items.append((one.lastgroup, word))
            at = one.end()
        return Tokens(items)

    def tree(self, tokens: Tokens, level: int = 0) -> Tree:
        if level == len(self.operators):
            return self.term(tokens)
        left = self.tree(tokens, level + 1)
        while tokens.peek() in self.operators[level]:
            operator = tokens.take()
            left = ("binary", operator, left, self.tree(tokens, level + 1))
        return left

    def term(self, tokens: Tokens) -> Tree:
        """Tree of an operand with signs, components and indices."""
        if tokens.peek() in self.unary:
            return ("unary", tokens.take(), self.term(tokens))
        tree = self._atom(tokens)
        while True:
            nxt = tokens.peek()
            if nxt == "." and tokens.kind(1) == "name":
                tokens.take()
                name = tokens.take()
                if self.brackets == "ur" and tokens.peek() == "(":
                    tokens.take()
                    tree = ("method", tree, name, self.items(tokens, ")"))
                else:
                    tree = ("field", tree, name)
            elif nxt == ("{" if self.brackets == "rapid" else "["):
                tokens.take()
                indices = self.items(tokens, "}" if self.brackets == "rapid" else "]")
                tree = ("index", tree, indices[0][1] if indices else ("number", 0.0))
            else:
                return tree

    def _atom(self, tokens: Tokens) -> Tree:
        kind, text = tokens.kind(), tokens.take()
        if kind == "number":
            return ("number", float(text))
        if kind == "text":
            return ("text", text)
        if text == "(":
            tree = self.tree(tokens)
            tokens.take(")")
            return tree
        if kind == "pose":
            return ("pose", [one for _, one in self.items(tokens, "]")])
        if text == "[" and self.brackets != "krl":
            return ("list", [one for _, one in self.items(tokens, "]")])
        if text == "{" and self.brackets == "krl":
            return self._aggregate(tokens)
        if kind == "name":
            if tokens.peek() == "(":
                tokens.take()
                return ("call", text, self.items(tokens, ")"))
            return ("name", text)
        raise NotUnderstood(text)

    def _aggregate(self, tokens: Tokens) -> Tree:
        """Tree of an aggregate after its bracket."""
        kind = ""
        if tokens.kind() == "name" and tokens.peek(1) == ":":
            kind = tokens.take()
            tokens.take(":")
        pairs = []
        while tokens.peek() != "}":
            if pairs:
                tokens.take(",")
            name = tokens.take()
            if tokens.peek() == "[":
                tokens.take()
                tokens.take("]")
            pairs.append((name, self.tree(tokens)))
        tokens.take("}")
        return ("aggregate", kind, pairs)

    def items(self, tokens: Tokens, end: str) -> list[tuple[str, Tree]]:
        """Arguments or elements up to an end token, each with its keyword or an empty string."""
        items: list[tuple[str, Tree]] = []
        while tokens.peek() != end:
            if tokens.peek() == ",":
                tokens.take()
                continue
            keyword = ""
            if self.brackets == "rapid" and tokens.peek() == "\\":
                tokens.take()
                keyword = tokens.take()
                if tokens.peek() == ":=":
                    tokens.take()
                else:
                    items.append((keyword, ("name", keyword)))
                    continue
            elif self.brackets == "ur" and tokens.kind() == "name" and tokens.peek(1) == "=":
                keyword = tokens.take()
                tokens.take("=")
            items.append((keyword, self.tree(tokens)))
        tokens.take(end)
        return items


_NUMBER = r"(?P<number>\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)"
UR = Syntax(
    re.compile(
        r"[ \t]+|(?P<pose>p\[)|" + _NUMBER + r'|(?P<text>"[^"]*")|(?P<name>[A-Za-z_]\w*)'
        r"|(?P<mark><=|>=|==|!=|[-+*/%<>=()\[\],.:])"
    ),
    (("or", "xor"), ("and",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "%")),
    ("-", "+", "not"),
    "ur",
)
KRL = Syntax(
    re.compile(
        r"\s+|" + _NUMBER + r"|(?P<text>\"[^\"]*\"|'[^']*')|(?P<name>[$A-Za-z_#][\w$#]*)"
        r"|(?P<mark><>|<=|>=|==|[-+*/<>=(){}\[\],.:])"
    ),
    (("OR", "EXOR", "B_OR"), ("AND", "B_AND"), ("==", "<>", "<", ">", "<=", ">="), ("+", "-"), ("*", "/"), (":",)),
    ("-", "+", "NOT", "B_NOT"),
    "krl",
    fold=True,
)
RAPID = Syntax(
    re.compile(
        r"\s+|"
        + _NUMBER
        + r'|(?P<text>"[^"]*")|(?P<name>[A-Za-z_][\w]*)|(?P<mark>:=|<>|<=|>=|[-+*/<>=(){}\[\],.:;\\?])'
    ),
    (("OR", "XOR"), ("AND",), ("=", "<>", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "DIV", "MOD")),
    ("-", "+", "NOT"),
    "rapid",
    fold=True,
)


def arithmetic(operator: str, a: Any, b: Any) -> Any:
    """Sum, difference, product or quotient of two numbers; False for other values and operators."""
    if not isinstance(a, float | int) or not isinstance(b, float | int):
        return False
    match operator:
        case "+":
            return a + b
        case "-":
            return a - b
        case "*":
            return a * b
        case "/":
            return a / b if b else 0.0
    return False
