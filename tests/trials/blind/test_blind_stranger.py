"""The generator shares no code with the project; test_blind_agrees compares its kinematics and effects with rig."""

import ast
import sys
from pathlib import Path

from tests.worlds import stranger

HERE = Path(stranger.__file__).parent
AROUND = {"importlib", "runpy", "subprocess", "multiprocessing", "ctypes"}
ALLOWED = ({"numpy", "yaml"} | set(sys.stdlib_module_names)) - AROUND


def test_the_stranger_imports_nothing_of_the_project():
    files = sorted(HERE.rglob("*.py"))
    assert len(files) > 10
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            others = {name for name in names if not f"{name}.".startswith("tests.worlds.stranger.")}
            assert {name.split(".")[0] for name in others} <= ALLOWED, f"{file.name}: {names}"
            assert not (isinstance(node, ast.Name) and node.id in ("__import__", "exec", "eval")), file.name
