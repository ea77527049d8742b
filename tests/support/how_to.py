"""Follow a page of docs/how-to literally in a copy of the repository: its `cp` commands, diffs and other commands."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
HOW_TO = ROOT / "docs" / "how-to"
FOLDERS = ("rigs", "daq", "analysis", "scripts", "docs", "tests")
FILES = ("pyproject.toml", "README.md", "CONTRIBUTING.md")
BIN = Path(sys.executable).parent
PATIENCE_S = 550.0
"""Time limit for blocked commands, generous because other programs may use most of the computer."""


def blocks(page: str, language: str) -> list[str]:
    text = (HOW_TO / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


def run(tree: Path, *command: str, timeout_s: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
    """Run a command of the environment with the code of a tree."""
    env = os.environ | {"PYTHONPATH": str(tree), "XDG_RUNTIME_DIR": str(tree), "PATH": f"{BIN}:{os.environ['PATH']}"}
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tree, env=env, timeout=timeout_s)


def output(tree: Path, *command: str) -> str:
    """Run a command and return its output. Fails if the command fails."""
    done = run(tree, *command)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@contextmanager
def checked_types() -> Generator[Path, None, None]:
    """Lock the mypy cache of this tree and yield it. `scripts/test` holds the lock while it runs mypy."""
    lock = ROOT / ".pytest_cache" / "mypy.lock"
    lock.parent.mkdir(exist_ok=True)
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield ROOT / ".mypy_cache"


def followed(page: str, tree: Path) -> list[str]:
    """Copy the repository and apply the example of a page to the copy. Return the changed files."""
    for name in FOLDERS:
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "corpus"))
    for name in FILES:
        shutil.copy(ROOT / name, tree)
    with checked_types() as cache:  # of what the page leaves as it is
        if cache.is_dir():
            shutil.copytree(cache, tree / ".mypy_cache")
    (copy,) = (block for block in blocks(page, "sh") if block.startswith("cp "))
    example = HOW_TO / copy.split()[2].removeprefix("docs/how-to/")
    new = [str(path.relative_to(example)) for path in sorted(example.rglob("*.py"))]
    output(tree, "bash", "-ec", copy)
    changed = []
    for block in blocks(page, "diff"):
        header, *lines = block.splitlines()
        path = tree / header.removeprefix("+++ ")
        path.write_text(edited(path.read_text(encoding="utf-8"), lines), encoding="utf-8")
        changed.append(str(path.relative_to(tree)))
    return list(dict.fromkeys([*new, *changed]))


def edited(text: str, lines: list[str]) -> str:
    """Return text with a diff applied: each + line is inserted after the preceding line, each - line is removed."""
    at = 0
    for line in lines:
        mark, wanted = line[:1], line[1:] + "\n"
        if mark == "+":
            text = text[:at] + wanted + text[at:]
            at += len(wanted)
            continue
        assert text.count(wanted, at) == 1, f"{wanted!r} stands there {text.count(wanted, at)} times"
        begin = text.index(wanted, at)
        at = begin + len(wanted)
        if mark == "-":
            text, at = text[:begin] + text[at:], begin
    return text


def offers(site: Path, name: str, points: dict[str, dict[str, str]]) -> None:
    """Write the entry points of a package into a directory of packages, as an installer does."""
    info = site / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    lines = [
        f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in of.items()) for group, of in points.items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def reinstalled(tree: Path) -> None:
    """Write the entry points of the tree's pyproject.toml, as a new installation of rig does."""
    project = tomllib.loads((tree / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    offers(tree, project["name"], project["entry-points"])


def checked(tree: Path, files: list[str]) -> None:
    """Check style and types of the Python files that a page adds or changes."""
    python = [name for name in files if name.endswith(".py")]
    output(tree, "ruff", "check", "--no-cache", *python)
    output(tree, "ruff", "format", "--no-cache", "--check", *python)
    output(tree, "mypy", *(name for name in python if not name.startswith("tests/")))


def commands(page: str, program: str) -> str:
    """Single code block of a page that uses a program, without the line that changes PATH."""
    (block,) = (
        block for block in blocks(page, "sh") if f"{program} " in block and not block.startswith(("cp ", "scripts"))
    )
    return block.replace("PATH=$PWD/.venv/bin:$PATH\n", "")
