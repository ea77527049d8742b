import pytest

from tests.support import nightly
from tests.support.measured_series import DATA
from tests.trials.next_lines.next_line_cases import cases, followed
from tests.trials.next_lines.next_lines import hints_of, table

CASES = list(cases(DATA))


@pytest.mark.parametrize(
    ("line", "commands"),
    [
        ("next: rig correct cell.yaml --for ur -o out-ur  # or fanuc", ["rig correct cell.yaml --for ur -o out-ur"]),
        (
            "next: rig diagnose RUN… --rig cell.yaml, or rig correct cell.yaml -o corrections",
            ["rig diagnose RUN… --rig cell.yaml", "rig correct cell.yaml -o corrections"],
        ),
        ("error: x: lacks it; see rig arms for one, or rig arms ur10e", ["rig arms", "rig arms ur10e"]),
        ("ready; next: rigd cell/rig.yaml; then type here: acw", ["rigd cell/rig.yaml"]),
        ("correct it: rig relabel 'a run' --direction acw, or not", ["rig relabel 'a run' --direction acw"]),
        ("rig finds out why a robot arm is not accurate", []),
    ],
)
def test_the_commands_of_a_line_are_seen(tmp_path, line, commands):
    assert [str(hint) for hint in hints_of(line, tmp_path) if hint.words[1:] and hint.words[1] != "finds"] == commands


@pytest.mark.cpu_limit(240)
@pytest.mark.parametrize("case", nightly.cases(CASES, lambda case: case.quick))
def test_every_hint_comes_to_an_end(tmp_path, case):
    found = followed(case, tmp_path)
    assert not found.dead, table({case.name: found})
