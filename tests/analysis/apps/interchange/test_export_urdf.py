import re

import pytest
import yaml

from rigs.load import find
from tests.support.command_line import errors_of, ran, succeeded
from tests.support.written_files import contents

EFFECTS = """
effects:
  - {effect: joint_offset, axis: 2, offset_deg: 0.05}
  - {effect: link_geometry, axis: 3, field: a, delta: 0.4}
"""
COMPLIANCE = "  - {effect: compliance, axis: 2, deg_per_Nm: 5.0e-5}\n"


@pytest.fixture
def cell(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text(find("ur10e-cell").read_text() + EFFECTS)
    return file


def test_a_urdf_is_written_once(cell, tmp_path):
    done = succeeded(f"export-urdf {cell} -o {tmp_path}/arm.urdf")
    assert "wrote " in done.stderr
    assert "All of" in done.stderr
    text = (tmp_path / "arm.urdf").read_text()
    assert ran(f"export-urdf {cell}").stdout == text
    errors_of(f"export-urdf {cell} -o {tmp_path}/arm.urdf")
    succeeded(f"import-urdf {tmp_path}/arm.urdf")


def test_ignored_effects_are_reported_with_their_share(cell):
    cell.write_text(cell.read_text() + COMPLIANCE)
    done = ran(f"export-urdf {cell}")
    said = re.search(r"by ([\d.]+) µm rms .*; ([\d.]+) µm rms .* \(.*\s+axis 2", done.stderr)
    assert said, done.stderr
    every, left = map(float, said.groups())
    assert 0 < left < every
    assert re.search(r"deflection under\s+load of\s+axis 2", done.stdout)


def test_driver_file_differs_in_hash_from_the_controller(cell):
    done = ran(f"export-urdf {cell} --for ur-driver")
    assert yaml.safe_load(done.stdout)["kinematics"]["upper_arm"]["pitch"] == pytest.approx(-0.05 * 3.14159265 / 180)
    assert "will report a calibration mismatch" in done.stderr
    known = ran(f"export-urdf {cell} --for ur-driver --hash calib_42")
    assert "hash: calib_42" in known.stdout
    assert "will report" not in known.stderr


def test_a_urdf_has_no_hash(cell):
    done = ran(f"export-urdf {cell} --hash calib_42")
    assert done.returncode == 2
    assert done.stdout == ""


def test_a_coupled_arm_is_refused_in_one_line(cell, tmp_path):
    data = contents(cell)
    data["robot"]["coupling"] = [[float(i == k or (i, k) == (2, 1)) for k in range(6)] for i in range(6)]
    cell.write_text(yaml.safe_dump(data))
    told = errors_of(f"export-urdf {cell} -o {tmp_path}/arm.urdf")
    assert told.startswith("error: ") and "axis 3 " in " ".join(told.split())
    assert not (tmp_path / "arm.urdf").exists()
