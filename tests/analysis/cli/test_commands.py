import pytest
import typer

from analysis.cli.commands import imported
from tests.analysis.cli.test_imports import modules_of

NO_COMMANDS = {f"analysis.cli.{name}" for name in ("commands", "console", "options", "completion", "several")}
"""Files of that folder which several commands share."""


@pytest.mark.parametrize(
    ("words", "file"),
    [
        (["analyse", "--help"], {"analysis.apps.report.cli_analyse"}),
        (["import", "--help"], {"analysis.cli.import_"}),
        (["circle", "fit", "--help"], {"analysis.apps.commission.cli_circle"}),
        (["keep", "--help"], {"analysis.cli.runs"}),
        (["--help"], set()),
        (["--version"], set()),
    ],
)
def test_only_the_file_of_the_command_that_is_called_is_imported(words, file):
    files = {module for module in modules_of(*words) if module.startswith("analysis.cli.") or ".cli_" in module}
    assert files - NO_COMMANDS == file


def test_a_group_is_imported_whole():
    group = imported("record")
    assert not isinstance(group, typer.core.TyperCommand) and set(group.commands) == {"start", "stop", "touch"}
