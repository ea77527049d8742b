import ast
import re

from pydantic import TypeAdapter

from daq.discovery.attempts import RobotReport
from rigs.schema.feedback import Feedback
from tests.support.command_line import errors_of, ran


def test_absent_controller_gets_its_files_and_the_reason_is_named(tmp_path):
    cell = tmp_path / "cell.yaml"
    words = ("init", cell, "--robot", "linuxcnc://127.0.0.1:1", "--arm", "ur10e")
    assert "refused" in errors_of(*words, exit_code=4) and not cell.exists()
    hal = (tmp_path / "linuxcnc" / "rig.hal").read_text()
    joints = re.findall(r"^net rig-joint-(\d) joint\.(\d)\.pos-fb => sampler\.0\.pin\.(\d)$", hal, re.M)
    assert joints == [(str(joint),) * 3 for joint in range(6)]
    assert re.search(r"^loadusr \S+ rigfeed\.py 1 0$", hal, re.M)
    feed = (tmp_path / "linuxcnc" / "rigfeed.py").read_text()
    imported = set(re.findall(r"^(?:import|from) (\w+)", feed, re.M))
    assert ast.parse(feed, feature_version=(3, 9)) and not imported & {"daq", "rigs", "analysis"}


def test_files_that_exist_are_kept(tmp_path):
    (tmp_path / "linuxcnc").mkdir()
    for name in ("rig.hal", "rigfeed.py"):
        (tmp_path / "linuxcnc" / name).write_text("edited")
    ran(f"init {tmp_path}/cell.yaml --robot linuxcnc://127.0.0.1:1 --arm ur10e")
    assert {(tmp_path / "linuxcnc" / name).read_text() for name in ("rig.hal", "rigfeed.py")} == {"edited"}


FOUND = RobotReport(
    "linuxcnc://127.0.0.1:1",
    TypeAdapter(Feedback).validate_python({"interface": "linuxcnc", "port": "tcp://127.0.0.1:1"}),
    (0.0,) * 6,
)


def test_sockets_are_offered_without_gauges(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.apps.commission.questionnaire.robot_at", lambda *_: FOUND)
    line = errors_of(f"init {tmp_path}/cell.yaml --robot linuxcnc://127.0.0.1:1 --arm ur10e", exit_code=2)
    assert "--measured-by sockets" in line
