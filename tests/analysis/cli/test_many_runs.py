import pytest

from analysis.cli.several import over_runs
from tests.support.command_line import ran
from tests.support.plant_runs import robot_of, write_visits


@pytest.fixture(scope="module")
def plant(tmp_path_factory):
    plant = tmp_path_factory.mktemp("plant")
    for seed, directory in enumerate(("a", "c")):
        assert list(write_visits(plant / directory, robot_of(1, 0, 365.0), [0.0, 30.0], ["yaw acw"], seed))
    (plant / "b").mkdir()
    (plant / "b" / "manifest.json").write_text("{}")
    return plant


@pytest.mark.parametrize("command", ["verify", "analyse", "analyse --json", "analyse --lines"])
def test_output_does_not_depend_on_processes(command, plant):
    one, two = (ran(f"{command} {plant} --jobs {jobs}") for jobs in ("1", "2"))
    assert one.returncode == 3 and one.stdout
    (error,) = (line for line in one.stderr.splitlines() if "note" not in line)
    assert str(plant / "b") in error
    assert (two.returncode, two.stdout, two.stderr) == (one.returncode, one.stdout, one.stderr)


def stops(item: int) -> int:
    if item == 2:
        raise KeyboardInterrupt
    return item


def test_ctrl_c_reports_progress(capsys):
    seen = []
    with pytest.raises(KeyboardInterrupt):
        over_runs(stops, [0, 1, 2, 3], seen.append, doing="counting")
    assert seen == [0, 1]
    assert capsys.readouterr().err.startswith("interrupted after 2 of 4 runs: ")
