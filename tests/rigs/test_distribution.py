"""What the package is called, how a part is added to it, and that nobody else's package is taken for one of its own."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rigs import distribution
from rigs.distribution import NAME, to_install, version
from rigs.entry import MARKS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
RECEIPT = """[tool]
requirements = [
    { name = "rig-metrology", path = "/tmp/rig metrology.whl" },
    { name = "weasyprint" },
    { name = "lxml", specifier = ">=5" },
]
"""
"""Of uv 0.13 after two parts were added; what the next command does not name, uv removes."""
BENEATH = getattr(sys, "_base_executable", "python3")  # private: the remedy names the Python beneath an environment
"""The Python of which this environment was made: on a path with the environment first, `python3` has no pip."""
OF_A_PROGRAM = [
    ("pipx_metadata.json", "", f"add it: pipx inject {NAME} 'asyncua<2.2,>=2.1' lxml"),
    ("uv-receipt.toml", "", f"add it: uv tool install --with 'asyncua<2.2,>=2.1' --with lxml {NAME}"),
    ("uv-receipt.toml", RECEIPT[:-9], f"add it: uv tool install --with 'asyncua<2.2,>=2.1' --with lxml {NAME}"),
    ("uv-receipt.toml", "tool = 3", f"add it: uv tool install --with 'asyncua<2.2,>=2.1' --with lxml {NAME}"),
    (
        "uv-receipt.toml",
        RECEIPT,
        "add it: uv tool install --with weasyprint --with 'lxml>=5' --with 'asyncua<2.2,>=2.1' --with lxml "
        "'/tmp/rig metrology.whl'",
    ),
    ("pyvenv.cfg", "", f"add it: {BENEATH} -m pip --python {sys.executable} install 'asyncua<2.2,>=2.1' lxml"),
    ("pip.py", "", f"add it: {sys.executable} -m pip install 'asyncua<2.2,>=2.1' lxml"),
]


def test_name_and_version_are_those_of_the_project() -> None:
    assert (NAME, version()) == (PROJECT["name"], PROJECT["version"])


@pytest.mark.parametrize(("file", "text", "line"), OF_A_PROGRAM)
def test_a_missing_part_is_added_where_rig_runs(
    file: str, text: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / file).write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr(distribution, "find_spec", lambda name: (tmp_path / f"{name}.py").is_file() or None)
    assert to_install("asyncua", "lxml") == line


def test_uvx_is_called_with_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "uv" / "archive-v0" / "kfnqAySRyT3OaFio"))
    assert to_install("weasyprint") == f"add it: uvx --with 'weasyprint>=70' --from {NAME} rig"


def test_sources_that_were_only_copied_have_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distribution, "NAME", "rig-that-nobody-installed")
    assert version() == "not installed"


@pytest.mark.parametrize("package", sorted(MARKS))
@pytest.mark.parametrize("program", ["rig", "rigd"])
def test_another_package_of_the_name_is_a_line(package: str, program: str, tmp_path: Path) -> None:
    """ROS puts its folders before all others on PYTHONPATH; the daemon needs no `analysis`."""
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").touch()
    command = [Path(sys.executable).parent / program, "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={"PYTHONPATH": str(tmp_path)})
    if (program, package) == ("rigd", "analysis"):
        assert (done.returncode, done.stdout) == (0, f"rigd {version()}\n")
        return
    folder = str(tmp_path / package)
    assert (done.returncode, done.stderr) == (
        4,
        f"error: {program}: a different package {package}, in {folder!r}, hides the package of rig; "
        f"run env -u PYTHONPATH {program}, or remove that folder from PYTHONPATH\n",
    )


def test_each_mark_is_a_file_of_the_wheel() -> None:
    assert all((ROOT / package / file).is_file() for package, file in MARKS.items())
