from hashlib import sha256
from pathlib import Path

import pytest

import analysis
from daq.store import verify
from rigs import load as reading
from rigs.calibration import CALIBRATION
from tests.support.bench import Bench, rig_text
from tests.support.handmade_calibration import calibrated_model, written
from tests.support.refusals import refused

FILE = f"cell{CALIBRATION}"


@pytest.fixture(autouse=True)
def _nothing_remembered():
    """Clear the caches before each test, as in a new process."""
    reading._calibrations.clear()  # private: calibrations are kept by their digest
    yield
    reading._calibrations.clear()  # private: as above


def simulated(tmp_path: Path) -> Path:
    rig_file, beside = written(tmp_path / "cell")
    run = analysis.save_run(analysis.simulate(rig_file, "yaw", "cw", seed=1), tmp_path / "run")
    rig_file.unlink()
    beside.unlink()
    return run


def test_a_saved_run_keeps_the_calibration_to_the_byte(tmp_path):
    content = written(tmp_path / "same")[1].read_bytes()
    run = simulated(tmp_path)
    assert (run / FILE).read_bytes() == content
    assert verify(run) == []
    assert analysis.load_run(run).rig.calibrated == calibrated_model()


def test_such_a_run_is_compared_without_its_rig_file_and_saved_again_with_it(tmp_path):
    run = analysis.load_run(simulated(tmp_path))
    alone = analysis.compare([run]).to_dict()
    rig_file, _ = written(tmp_path / "again")
    given = analysis.compare([run], rig_file).to_dict()
    assert alone == given
    copy = analysis.save_run(run, tmp_path / "copy")
    assert analysis.load_run(copy).rig.calibrated == calibrated_model()


def test_a_changed_calibration_is_refused_and_a_run_without_it_is_as_before(tmp_path):
    run = simulated(tmp_path)
    (run / FILE).write_bytes((run / FILE).read_bytes() + b" ")
    reading._calibrations.clear()  # private: as above
    assert [line for line in verify(run) if "SHA-256" in line]
    with refused("calibration.invalid", "differs from that in the rig"):
        analysis.load_run(run)
    (run / FILE).unlink()
    assert verify(run) == []
    with refused("calibration.missing", "which is missing in the directory"):
        analysis.compare([analysis.load_run(run)])


def test_recorded_run_keeps_the_calibration_of_its_start(tmp_path):
    beside = written(tmp_path, calibrated_model(rig="bench"))[1]
    content = beside.read_bytes()
    text = f"{rig_text()}calibration: {{file: {beside.name}, sha256: {sha256(content).hexdigest()}}}\n"
    with Bench(tmp_path, text) as bench:
        bench.start().all_reading()
        beside.write_text("something else")
        bench.record("dwell", "cw")
        bench.run("rig", "record", "stop")
    (run,) = (tmp_path / "runs").glob("*_dwell")
    assert (run / FILE).read_bytes() == content
    assert verify(run) == []
