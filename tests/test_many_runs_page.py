import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command_line import ran
from tests.support.plant_runs import robot_of, write_visits

PAGE = (Path(__file__).parents[1] / "docs" / "many-runs.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.S)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
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
