import pytest
import yaml

from rigs.arms import arm_names, load_arm
from rigs.schema.robot import Robot
from tests.support.command_line import errors_of, json_of, ran, succeeded
from tests.support.second_sources import SOURCES
from tests.support.written_files import contents


def test_the_table_names_every_arm():
    done = succeeded("arms", COLUMNS="80")
    assert [name for name in arm_names() if f"{name} " not in done.stdout] == []
    assert f"{len(arm_names())} arms" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


def test_the_table_as_json_has_all_of_it():
    found = json_of("arms")["arms"]
    assert [one["name"] for one in found] == list(arm_names())
    assert all(Robot.model_validate(one["robot"]) == load_arm(one["name"]).robot for one in found)
    assert found[0]["sources"]["second"].startswith("robotkinematicscatalogue")


def test_arm_is_shown_with_sources_in_pasteable_form():
    done = ran("arms staubli-tx2-60")
    assert "# Staubli TX2-60, repeatability 0.02 mm" in done.stdout
    assert "# geometry: ros-industrial/staubli_experimental" in done.stdout
    assert Robot.model_validate(yaml.safe_load(done.stdout)["robot"]) == load_arm("staubli-tx2-60").robot
    assert json_of("arms staubli-tx2-60")["name"] == "staubli-tx2-60"


def test_an_arm_is_written_once(tmp_path):
    file = tmp_path / "arm.yaml"
    done = ran(f"arms ur10e -o {file}")
    assert (done.returncode, done.stdout) == (0, "")
    assert file.read_text() == ran("arms ur10e").stdout
    assert "exists already" in errors_of(f"arms ur3e -o {file}")


def test_an_option_for_one_arm_asks_for_its_name():
    errors_of("arms -o arm.yaml", exit_code=2)
    errors_of("arms ur11e")


def test_a_calibration_is_taken_in(tmp_path):
    lists = "\n".join(f"delta_{name} = [0, 0.0001, 0, 0, 0, 0]" for name in ("theta", "a", "d", "alpha"))
    file = tmp_path / "calibration.conf"
    file.write_text(f"[mounting]\n{lists}\n")
    done = ran(f"arms ur10e --calibration {file}")
    robot = yaml.safe_load(done.stdout)["robot"]
    assert (robot["arm"], robot["controller"]) == ("ur10e", "constants")
    found = json_of(f"arms ur10e --calibration {file}")
    assert Robot.model_validate(found["robot"]) == Robot.model_validate(robot)


@pytest.fixture
def urdf(tmp_path):
    chain = SOURCES["abb-irb-120"]["geometry"]
    file = tmp_path / "arm.urdf"
    file.write_text(chain.urdf())
    return file


def test_a_urdf_becomes_a_section(urdf, tmp_path):
    done = ran(f"import-urdf {urdf} -o {tmp_path}/arm.yaml")
    assert (done.returncode, done.stdout) == (0, "")
    assert "tool0: " in done.stderr
    text = (tmp_path / "arm.yaml").read_text()
    assert "arm.urdf: " in text
    Robot.model_validate(yaml.safe_load(text)["robot"])
    assert ran(f"import-urdf {urdf}").stdout == text
    errors_of(f"import-urdf {urdf} -o {tmp_path}/arm.yaml")


def test_urdf_without_build_reports_the_assumed_one(urdf, tmp_path):
    """Plays that are usual of hobby servos are faults of an industrial arm."""
    told = " ".join(ran(f"import-urdf {urdf}").stderr.split())
    assert "construction" in told and "--build servo" in told
    done = ran(f"import-urdf {urdf} --build servo -o {tmp_path}/arm.yaml")
    section = contents(tmp_path / "arm.yaml")["robot"]
    assert Robot.model_validate(section).design == "servo" and "construction" not in done.stderr


def test_nothing_is_written_of_a_bad_urdf(urdf, tmp_path):
    errors_of(f"import-urdf {urdf} --tip link_3 -o {tmp_path}/arm.yaml")
    assert not (tmp_path / "arm.yaml").exists()


def test_names_in_a_urdf_are_printed_plain(urdf):
    urdf.write_text(urdf.read_text().replace('"tool0"', '"tip&#x9b;31m&#10;robot: 1"').replace("joint_1", "a&#x202e;"))
    done = succeeded(f"import-urdf {urdf}")
    assert [char for char in done.stdout + done.stderr if not char.isprintable() and char != "\n"] == []
    Robot.model_validate(yaml.safe_load(done.stdout)["robot"])
