import pytest
from typer.testing import CliRunner

from analysis.cli import app


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        (("--test", "pose"), "'pose'"),
        (("--test", "radial", "--direction", "cw"), "radial test"),
    ],
)
def test_impossible_simulation_is_refused(asked, says, tmp_path):
    result = CliRunner().invoke(app, ["simulate", "ur10e", *asked, "-o", str(tmp_path / "runs")])
    assert result.exit_code == 2 and says in " ".join(result.output.replace("│", " ").split())
    assert not (tmp_path / "runs").exists()
