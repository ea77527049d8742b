import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.support.nightly import cases

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RIG = Path(sys.executable).parent / "rig"
OFFLINE = 75


def _run(*command: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)


@pytest.mark.cpu_limit(300)
@pytest.mark.parametrize("borrow", cases((True, False), (True,)), ids=["installed", "registry"])
def test_the_wheel_works_in_an_empty_environment(borrow):
    """That pyproject.toml names every package, each extra's too, is for a night and each release: it takes minutes."""
    done = _run(sys.executable, ROOT / "scripts" / "tools" / "wheel.py", "--borrow" if borrow else "--extras")
    if done.returncode == OFFLINE:
        pytest.skip(done.stderr.splitlines()[-1])
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"rig {PROJECT['version']}; rigd starts" in done.stdout


def test_the_citation_has_version_and_date_of_the_last_release():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    released = re.search(r"^## \[(.+)\] - (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert released and (str(citation["version"]), str(citation["date-released"])) == released.groups()


def test_the_version_stands_in_one_place_and_in_the_citation():
    tracked = _run("git", "ls-files", "-z", "*.py", "*.cff", "*.md", "*.toml", "scripts").stdout.split("\0")
    quoted = re.compile(rf"(?<![\d.]){re.escape(PROJECT['version'])}(?![\d.])")
    found = [name for name in tracked if name and quoted.search((ROOT / name).read_text())]
    assert [name for name in found if not name.endswith(("CHANGELOG.md", ".lock"))] == [
        "CITATION.cff",
        "pyproject.toml",
    ]


def test_the_extra_of_all_holds_every_other_but_that_of_developers():
    extras = dict(PROJECT["optional-dependencies"])
    (whole,) = extras.pop("all")
    name, _, held = whole.rstrip("]").partition("[")
    assert name == PROJECT["name"]
    assert set(held.split(",")) == set(extras) - {"dev"}


def test_example_writes_valid_rig_files_and_replaces_none(tmp_path):
    done = _run(RIG, "example", tmp_path / "rigs")
    assert done.returncode == 0, done.stderr
    written = {Path(line).name for line in done.stdout.splitlines()}
    assert written == {path.name for path in (ROOT / "rigs").glob("*.yaml")}
    assert _run(RIG, "check", tmp_path / "rigs" / "ur10e-cell.yaml").returncode == 0
    (tmp_path / "rigs" / "ur10-cell.yaml").unlink()
    again = _run(RIG, "example", tmp_path / "rigs")
    assert (again.returncode, again.stdout) == (3, "")
    assert again.stderr.startswith(f"error: {tmp_path}/rigs/paper-errors.yaml: ")
    assert not (tmp_path / "rigs" / "ur10-cell.yaml").exists()


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "1.2.3"\n')
    (tmp_path / "CITATION.cff").write_text("version: 1.2.3\n")
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## [1.2.3] - 2026-11-21\n\n- New.\n\n## 1.2.2\n\n- Old.\n")
    _run("git", "init", "--quiet", cwd=tmp_path)
    _commit(tmp_path)
    return tmp_path


def _commit(checkout: Path) -> None:
    who = ("-c", "user.name=anybody", "-c", "user.email=anybody@example.org")
    _run("git", "add", ".", cwd=checkout)
    assert _run("git", *who, "commit", "--quiet", "--message", "all", cwd=checkout).returncode == 0


def _checklist(checkout: Path) -> tuple[int, list[str]]:
    done = _run(sys.executable, ROOT / "scripts" / "tools" / "release.py", "--quick", cwd=checkout)
    return done.returncode, [line.strip() for line in done.stdout.splitlines() if "LACKS" in line]


def test_a_release_that_is_ready_lacks_nothing(checkout):
    assert _checklist(checkout) == (0, [])


def test_a_release_is_refused_for_each_thing_that_it_lacks(checkout):
    _run("git", "tag", "v1.2.3", cwd=checkout)
    sections = "## [Unreleased]\n\n- New.\n\n## [1.2.2] - 2026-11-20\n\n- Old.\n"
    (checkout / "CHANGELOG.md").write_text(f"# Changelog\n\n{sections}")
    code, lacking = _checklist(checkout)
    assert code == 1 and len(lacking) == 4 and "v1.2.3" in lacking[1]
