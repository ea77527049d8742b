"""Generate docs/errors.md from the calls that make errors: `scripts/dev errors_page > docs/errors.md`.

A call with `code="area.problem"` is a row: its second and third arguments are the problem and the remedy, with `…` for
each value. Calls with the same code share a row.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
HEAD = """\
# Error codes

Every expected failure has a code that does not change when the text improves. With `--json`, a command prints the
failure on standard error as one line, `{"error": {"code": …, "where": …, "what": …, "remedy": …, "exit_code": …}}`; in
Python it is `RigError.code`. The [exit code](command-line.md#exit-codes) states the kind: `usage` (2), `file` (3),
`cell` (4). These three are also the codes of failures that have no code of their own.

This page is generated from the source: `scripts/dev errors_page > docs/errors.md`.
"""


def page() -> str:
    """Return the page as Markdown: a table for each area, rows in alphabetical order."""
    rows: dict[str, dict[str, dict[tuple[str, str], None]]] = defaultdict(lambda: defaultdict(dict))
    for file in sorted(file for top in ("rigs", "daq", "analysis") for file in (ROOT / top).rglob("*.py")):
        for code, problem, remedy in codes_in(ast.parse(file.read_text("utf-8"))):
            rows[code.partition(".")[0]][code][problem, remedy] = None
    parts = [HEAD]
    for area, codes in sorted(rows.items()):
        parts.append(f"## {area}\n\n| code | problem | remedy |\n| --- | --- | --- |")
        for code, texts in sorted(codes.items()):
            problems, remedies = (
                " / ".join(dict.fromkeys(filter(None, column))) for column in zip(*texts, strict=True)
            )
            parts.append(f"| `{code}` | {problems} | {remedies} |")
        parts.append("")
    return "\n".join(parts)


def codes_in(tree: ast.AST) -> Iterator[tuple[str, str, str]]:
    """Yield code, problem and remedy of each call with a literal code, in the order of the source."""
    values = [
        (name.id, node.lineno, value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        for target in node.targets
        for name, value in _pairs(target, node.value)
        if isinstance(name, ast.Name)
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            for line in node.body:
                if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "code" and "." in ast.unparse(line):
                    yield ast.literal_eval(line.value), (ast.get_docstring(node) or "").partition(". ")[0], ""
        if not isinstance(node, ast.Call):
            continue
        code = {word.arg: word.value for word in node.keywords}.get("code")
        if isinstance(code, ast.Constant) and isinstance(code.value, str) and "." in code.value:
            # The value of a variable is that of the last line above the call, otherwise a constant of the file.
            above = sorted(values, key=lambda value: (value[1] < node.lineno, value[1]))
            names = {name: value for name, _, value in above}
            texts = [*(_text(one, names) for one in node.args[1:3]), "", ""]
            yield code.value, texts[0], texts[1]


def _pairs(target: ast.expr, value: ast.expr) -> list[tuple[ast.expr, ast.expr]]:
    """Pair each name of an assignment with its value."""
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        return list(zip(target.elts, value.elts, strict=True))
    return [(target, value)]


def _text(node: ast.expr, names: dict[str, ast.expr]) -> str:
    """Return a literal, an f-string with `…` for its values, or that of the variable; otherwise `…`."""
    if isinstance(node, ast.Name):
        value = names.get(node.id)
        return "…" if value is None or isinstance(value, ast.Name) else _text(value, names)
    if isinstance(node, ast.Constant):
        return str(node.value).replace("|", "\\|").replace("<", "&lt;")
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part, names) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _text(node.left, names) + _text(node.right, names)
    return "…"


if __name__ == "__main__":
    print(page(), end="")
