"""Generate docs/errors.md from the list of codes: `scripts/dev errors_page > docs/errors.md`."""

from __future__ import annotations

from rigs.error_codes import ERROR_CODES

HEAD = """\
# Error codes

Every expected failure has a code that says what a script can do about it. The sentence tells the rest to a person and
may improve; the code does not change. With `--json`, a command prints the failure on standard error as one line,
`{"error": {"code": …, "where": …, "what": …, "remedy": …, "exit_code": …}}`; in Python it is `RigError.code`. The
[exit code](command-line.md#exit-codes) states the kind: `usage` (2), `file` (3), `cell` (4).

This page is generated from `rigs/error_codes.py`: `scripts/dev errors_page > docs/errors.md`.

| code | what to do |
| --- | --- |
"""


def page() -> str:
    """The page as Markdown."""
    return HEAD + "".join(f"| `{code}` | {action} |\n" for code, action in ERROR_CODES.items())


if __name__ == "__main__":
    print(page(), end="")
