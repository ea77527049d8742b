import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support import command_line
from tests.support.plant_runs import known_robot, write_visits
from tests.support.remote_stores import Store, s3_store, sftp_store

VISITS = 3
NEEDS = {"file": ("fsspec",), "s3": ("s3fs", "boto3", "moto"), "sftp": ("sshfs", "asyncssh")}
RIG = [sys.executable, "-c", "from analysis.cli import main; main()"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Two robots with a few runs each, a run that is damaged and one that lacks a chunk."""
    plant = tmp_path_factory.mktemp("written") / "plant"
    for number in (1, 2):
        one = known_robot(number, VISITS, 0.03 * (number - 1))
        runs = list(write_visits(plant / one.name, one, list(range(VISITS))))
    next(runs[0].glob("*.parquet")).unlink()
    (plant / "robot-001" / "bad").mkdir()
    (plant / "robot-001" / "bad" / "manifest.json").write_text("{}")
    return plant


@contextmanager
def store_of(kind: str, plant: Path, keys: Path) -> Iterator[Store]:
    for package in NEEDS[kind]:
        pytest.importorskip(package, reason=f"{package} is not installed: pip install s3fs sshfs 'moto[server]'")
    if kind == "file":
        yield Store(f"file://{plant}", {})
        return
    with s3_store(plant) if kind == "s3" else sftp_store(plant, keys) as store:
        yield store


@pytest.fixture(params=["file", "s3", "sftp"])
def store(request, written, tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with store_of(request.param, written, tmp_path / "keys") as made:
        settings = made.environment | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "TMPDIR": str(temporary)}
        for name, value in (settings | {"COLUMNS": "150"}).items():
            monkeypatch.setenv(name, value)
        yield written, made
        assert not [one for one in temporary.iterdir() if one.name.startswith("rig-")]


def ran(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command, in a separate process if the client of the store starts threads."""
    if not any(str(word).startswith(("s3:", "sftp:")) for word in words):
        return command_line.ran(*words)
    return command_line.separately(*RIG, *words)


@pytest.mark.parametrize("store", ["file"], indirect=True)
@pytest.mark.parametrize("command", ["verify {}", "analyse {}/robot-002 --json", "fleet {} --jobs 2"])
def test_output_equals_that_of_the_directory(store, command):
    """Commands read remote stores only through local copies of their files."""
    plant, made = store
    here, there = (ran(*command.format(place).split()) for place in (plant, made.url))
    mended = f"run `rig recover {plant}/robot-001/bad`"
    texts = (text.replace(made.url, str(plant)) for text in (there.stdout, there.stderr))
    out, err = (text.replace("run `rig recover` on a copy of the run", mended) for text in texts)
    assert (there.returncode, out, err) == (here.returncode, here.stdout, here.stderr) and here.stdout


@pytest.mark.parametrize("store", ["file"], indirect=True)
def test_unchanged_runs_are_not_read_again(store, tmp_path):
    plant, made = store

    def told() -> tuple[str, int]:
        states, read, _ = re.split(r"(\d+) of them", " ".join(ran("fleet", made.url).stdout.split()))
        return states, int(read)

    states, read = told()
    assert read == 2 * VISITS + 1 and told() == (states, 1)
    (touched,) = sorted((plant / "robot-002").iterdir())[0].glob("manifest.json")
    text = touched.read_text()
    touched.write_text(text + "\n")
    try:
        assert told()[1] == 2
    finally:
        touched.write_text(text)


@pytest.mark.parametrize("store", ["s3", "sftp"], indirect=True)
def test_a_signal_that_ends_it_leaves_no_copy(store):
    _, made = store
    with subprocess.Popen([*RIG, "verify", made.url], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGHUP)
        errors = process.stderr.read().decode()
    assert "Traceback" not in errors  # the fixture looks for what stays
    assert process.returncode == -signal.SIGHUP


def test_a_computer_whose_key_is_not_known_is_refused(written, tmp_path):
    with store_of("sftp", written, tmp_path / "keys") as made:
        (tmp_path / "known").touch()
        environment = os.environ | made.environment | {"FSSPEC_SFTP_KNOWN_HOSTS": str(tmp_path / "known")}
        done = command_line.separately(*RIG, "verify", made.url, env=environment)
    assert done.returncode == 4 and "host key" in done.stderr and done.stderr.count("\n") == 1


def test_no_password_is_taken_and_none_is_shown(capfd):
    done = ran("fleet", "sftp://me:hidden@127.0.0.1/plant")
    assert done.returncode == 3 and "contains a password" in done.stderr and "hidden" not in done.stderr
    assert done.stderr.count("\n") == 1
