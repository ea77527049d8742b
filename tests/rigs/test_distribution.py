import subprocess
import sys
from pathlib import Path

import pytest

from rigs import distribution
from rigs.distribution import to_install, version
from rigs.entry import MARKS

ROOT = Path(__file__).parents[2]


def test_a_missing_package_is_added_to_the_environment_of_rig():
    assert f"{sys.executable} -m pip" in to_install("asyncua", "lxml")


def test_sources_that_were_only_copied_have_no_version(monkeypatch):
    monkeypatch.setattr(distribution, "NAME", "rig-that-nobody-installed")
    assert version() == "not installed"


@pytest.mark.parametrize("package", sorted(MARKS))
@pytest.mark.parametrize("program", ["rig", "rigd"])
def test_another_package_of_the_name_is_a_line(package, program, tmp_path):
    """ROS puts its folders before all others on PYTHONPATH; the daemon needs no `analysis`."""
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").touch()
    command = [Path(sys.executable).parent / program, "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={"PYTHONPATH": str(tmp_path)})
    if (program, package) == ("rigd", "analysis"):
        assert (done.returncode, done.stdout) == (0, f"rigd {version()}\n")
        return
    (line,) = done.stderr.splitlines()
    assert done.returncode == 4 and line.startswith(f"error: {program}: ")
    assert repr(str(tmp_path / package)) in line and f"env -u PYTHONPATH {program}" in line


def test_each_mark_is_a_file_of_the_wheel():
    assert all((ROOT / package / file).is_file() for package, file in MARKS.items())
