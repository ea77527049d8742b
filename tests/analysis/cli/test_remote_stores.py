from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

from tests.support import command_line
from tests.support.dask_cluster import cluster
from tests.support.plant_runs import known_robot, write_visits
from tests.support.remote_stores import Store, s3_store, sftp_store

VISITS = 3
NEEDS = {"file": ("fsspec",), "s3": ("s3fs", "boto3", "moto"), "sftp": ("sshfs", "asyncssh")}
RIG = [sys.executable, "-c", "from analysis.cli import main; main()"]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots with a few runs each, a run that is damaged and one that lacks a chunk."""
    plant = tmp_path_factory.mktemp("written") / "plant"
    for number in (1, 2):
        one = known_robot(number, VISITS, 0.03 * (number - 1))
        runs = list(write_visits(plant / one.name, one, list(range(VISITS))))
    next(runs[0].glob("*.parquet")).unlink()
    list(write_visits(plant / "circles", known_robot(3, VISITS, 0.0), [0.0], ["yaw acw"]))
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
def store(
    request: pytest.FixtureRequest, written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Path, Store]]:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with store_of(request.param, written, tmp_path / "keys") as made:
        settings = made.environment | {"XDG_CACHE_HOME": str(tmp_path / "cache"), "TMPDIR": str(temporary)}
        for name, value in (settings | {"COLUMNS": "150"}).items():
            monkeypatch.setenv(name, value)
        yield written, made
        assert not [one for one in temporary.iterdir() if one.name.startswith("rig-")]


def ran(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command, in a separate process if the client of the store starts threads."""
    texts = [str(word) for word in words]
    if not any(text.startswith(("s3:", "sftp:")) for text in texts):
        return command_line.ran(*texts)
    return subprocess.run([*RIG, *texts], capture_output=True, text=True, check=False)


@cache
def printed_here(*words: str) -> tuple[int, str, str]:
    """What a command over a directory ends with and prints."""
    done = ran(*words)
    return done.returncode, done.stdout, done.stderr


def printed_there(plant: Path, url: str, *words: object) -> tuple[int, str, str]:
    """What a command over a URL ends with and prints, in the words that it has for the directory."""
    done = ran(*words)
    mended = f"run `rig recover {plant}/robot-001/bad`"
    texts = (text.replace(url, str(plant)) for text in (done.stdout, done.stderr))
    out, err = (text.replace("run `rig recover` on a copy of the run", mended) for text in texts)
    return done.returncode, out, err


COMMANDS = {
    "analyse": ("analyse {} --lines", "--jobs 2"),
    "verify": ("verify {}", ""),
    "json": ("analyse {}/robot-002 --json", ""),
    "fleet": ("fleet {}", "--jobs 2"),
    "history": ("history robot-001 --runs {} --json", ""),
}
"""Commands by name, each with additional options for remote stores."""


@pytest.mark.parametrize(
    ("store", "command"),
    [
        pytest.param(kind, name, marks=() if kind == "file" or name == "analyse" else pytest.mark.nightly)
        for kind in NEEDS
        for name in COMMANDS
    ],
    indirect=["store"],
)
def test_output_equals_that_of_the_directory(store, command):
    """Of other stores than a directory the commands know no more than the copies of its files."""
    plant, made = store
    words, more = (text.split() for text in COMMANDS[command])
    here = printed_here(*(word.format(plant) for word in words))
    there = printed_there(plant, made.url, *(word.format(made.url) for word in words), *more)
    assert there == here and here[1]


@pytest.mark.parametrize("store", ["file"], indirect=True)
def test_a_page_is_that_of_the_directory(store, tmp_path):
    plant, made = store
    for runs, page in ((f"{plant}/circles", "here.html"), (f"{made.url}/circles", "there.html")):
        assert ran("report", runs, "--no-diagnosis", "-o", tmp_path / page).returncode == 0
    when = re.compile(r"\d\d:\d\d UTC")  # the page was made
    pages = [when.sub("", (tmp_path / page).read_text()) for page in ("here.html", "there.html")]
    assert pages[1].replace(made.url, str(plant)) == pages[0]


@pytest.mark.parametrize("store", ["file"], indirect=True)
def test_both_sides_of_a_comparison_may_be_remote(store):
    plant, made = store
    before, after = (f"robot-001/{run.name}" for run in sorted((plant / "robot-001").glob("*_robot-001-*"))[:2])
    here = printed_here("compare", f"{plant}/{after}", "--against", f"{plant}/{before}", "--json")
    there = printed_there(
        plant, made.url, "compare", f"{made.url}/{after}", "--against", f"{made.url}/{before}", "--json"
    )
    assert there == here and here[0] == 0


@pytest.mark.parametrize("store", ["file", "s3", pytest.param("sftp", marks=pytest.mark.nightly)], indirect=True)
def test_unchanged_runs_are_not_read_again(store, tmp_path):
    plant, made = store

    def told() -> tuple[str, int]:
        states, read, _ = re.split(r"(\d+) of them", " ".join(ran("fleet", made.url).stdout.split()))
        return states, int(read)

    states, read = told()
    assert read == 2 * VISITS + 2 and told() == (states, 1)
    if made.url.startswith("s3"):
        return  # its files are copies
    (touched,) = sorted((plant / "robot-002").iterdir())[0].glob("manifest.json")
    text = touched.read_text()
    touched.write_text(text + "\n")
    try:
        assert told()[1] == 2
    finally:
        touched.write_text(text)


@pytest.mark.parametrize("store", ["s3", "sftp"], indirect=True)
def test_lost_store_is_one_line_and_results_stay(store):
    _, made = store
    assert made.process
    command = [*RIG, "analyse", made.url, "--lines"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout and process.stderr
        process.stdout.readline()
        made.process.kill()
        rest, errors = process.stdout.read(), process.stderr.read().splitlines()
    assert process.returncode == 4 and len(rest.splitlines()) < 2 * VISITS
    assert len(errors) <= 2
    assert ran("fleet", made.url).returncode == 4
    assert "secret" not in "".join(errors)


@pytest.mark.parametrize(
    ("store", "ends_by"),
    [("sftp", signal.SIGINT), ("sftp", signal.SIGTERM), ("sftp", signal.SIGHUP), ("s3", signal.SIGINT)],
    indirect=["store"],
)
def test_a_signal_that_ends_it_leaves_no_copy(ends_by, store):
    _, made = store
    with subprocess.Popen([*RIG, "verify", made.url], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout and process.stderr
        process.stdout.readline()
        process.send_signal(ends_by)
        errors = process.stderr.read().decode()
    assert "Traceback" not in errors  # the fixture looks for what stays
    assert process.returncode == (130 if ends_by is signal.SIGINT else -ends_by)


@pytest.mark.parametrize(
    "store", [*(pytest.param(kind, marks=pytest.mark.nightly) for kind in ("file", "s3")), "sftp"], indirect=True
)
def test_dask_workers_read_the_store_themselves(store, tmp_path):
    pytest.importorskip("distributed")
    plant, made = store
    (tmp_path / "dask").mkdir()
    with cluster(tmp_path / "dask") as there:
        lines = printed_there(plant, made.url, "analyse", made.url, "--lines", "--scheduler", there.address)
    assert lines == printed_here("analyse", str(plant), "--lines") and lines[1]


@pytest.mark.parametrize(("kind", "line"), [("s3", "error: s3://nowhere/x: "), ("sftp", "/nowhere: ")])
def test_missing_url_is_one_line(kind, line, written, tmp_path):
    with store_of(kind, written, tmp_path / "keys") as made:
        url = "s3://nowhere/x" if kind == "s3" else f"{made.url}/nowhere"
        environment = os.environ | made.environment
        for command in ("verify", "fleet"):
            done = subprocess.run([*RIG, command, url], env=environment, capture_output=True, text=True, check=False)
            assert done.returncode == 3 and line in done.stderr and done.stderr.count("\n") == 1
        denied = {"AWS_SECRET_ACCESS_KEY": "", "AWS_ACCESS_KEY_ID": "", "FSSPEC_SFTP_CLIENT_KEYS": ""}
        done = subprocess.run(
            [*RIG, "verify", made.url], env=environment | denied, capture_output=True, text=True, check=False
        )
        assert done.returncode == 3 and "permission denied" in done.stderr and done.stderr.count("\n") == 1


def test_a_computer_whose_key_is_not_known_is_refused(written, tmp_path):
    with store_of("sftp", written, tmp_path / "keys") as made:
        (tmp_path / "known").touch()
        environment = os.environ | made.environment | {"FSSPEC_SFTP_KNOWN_HOSTS": str(tmp_path / "known")}
        done = subprocess.run([*RIG, "verify", made.url], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 4 and "host key" in done.stderr and done.stderr.count("\n") == 1


def test_no_password_is_taken_and_none_is_shown(capfd):
    done = ran("fleet", "sftp://me:hidden@127.0.0.1/plant")
    assert done.returncode == 3 and "contains a password" in done.stderr and "hidden" not in done.stderr
    assert done.stderr.count("\n") == 1
