"""The commands and the snippet of docs/many-runs.md run, in order, on a plant of two small robots."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command_line import ran
from tests.support.plant_runs import robot_of, write_visits
from tests.support.remote_stores import s3_store, sftp_store

RIG = Path(sys.executable).with_name("rig")
PAGE = (Path(__file__).parents[1] / "docs" / "many-runs.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    work = tmp_path_factory.mktemp("work")
    for number in (1, 2):
        robot = robot_of(number, 0, 365.0)
        assert list(write_visits(work / "plant" / robot.name, robot, [0.0, 30.0], ["yaw acw", "yaw cw"], 0))
    return work


def test_commands_run_and_the_snippet_reads_their_output(work):
    for line in blocks("sh")[0].splitlines():
        _, *words = shlex.split(line, comments=True)
        output = words[words.index(">") + 1] if ">" in words else None
        done = ran(*words[: -2 if output else None], cwd=work)
        assert done.returncode == 0 and (done.stdout or "wrote" in done.stderr), (line, done.stderr)
        if output:
            (work / output).write_text(done.stdout)
    (snippet,) = blocks("python")
    done = subprocess.run([sys.executable, "-c", snippet], capture_output=True, text=True, cwd=work, check=True)
    assert re.search(r"robot-002 +yaw +4 ", done.stdout), done.stdout


@pytest.mark.nightly  # the stores are tested by tests/analysis/cli/test_remote_stores.py in each commit
def test_every_command_over_a_store_runs(work, tmp_path):
    for package in ("s3fs", "boto3", "moto", "sshfs", "asyncssh"):
        pytest.importorskip(package)
    commands = [line for line in blocks("sh")[2].splitlines() if line.startswith("rig ")]
    with s3_store(work) as s3, sftp_store(work, tmp_path / "keys") as sftp:
        environment = os.environ | s3.environment | sftp.environment | {"XDG_CACHE_HOME": str(tmp_path)}
        for line in commands:
            words = [word.replace("sftp://me@store", sftp.url) for word in shlex.split(line, comments=True)[1:]]
            done = subprocess.run(  # a client of a store starts threads of its own
                [RIG, *words], capture_output=True, text=True, cwd=tmp_path, check=False, env=environment
            )
            assert done.returncode == 0 and done.stdout, (line, done.stderr)
    assert len(commands) == 4 and (tmp_path / "plant.html").is_file()
