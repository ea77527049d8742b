import numpy as np
import pytest

from analysis.api import load_run
from rigs.arms import load_arm
from tests.support.command_line import ran

JOINTS = [f"J{axis}" for axis in range(1, 7)]


Q = np.random.default_rng(3).uniform(-1.5, 1.5, (12, 6))


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("touches")
    tests = "tests: {touch: {sockets: [A, B], ball_mm: [0, 0, 90]}}\n"
    (folder / "cell.yaml").write_text(f"name: cell\n{load_arm('ur10e').text}{tests}")
    return folder


@pytest.mark.parametrize(("header", "factor"), [(JOINTS, 1.0), ([f"joint_{axis}" for axis in range(6)], np.pi / 180)])
def test_joints_of_touches_are_read_under_the_names_of_a_pendant(cell, header, factor):
    name = f"touches-{header[0]}"
    rows = [",".join(["AB"[k % 2], *map(str, row)]) for k, row in enumerate(np.degrees(Q) * factor)]
    (cell / f"{name}.csv").write_text("\n".join([",".join(["socket", *header]), *rows]) + "\n")
    done = ran(f"import {name}.csv --rig cell.yaml --test touch -o {name}", cwd=cell)
    assert done.returncode == 0, done.stderr
    imported = load_run(cell / name).table
    assert np.allclose(imported.q, Q) and "".join(imported.socket) == 6 * "AB"


def test_one_socket_for_all_rows_is_an_option(cell):
    rows = [",".join(map(str, row)) for row in np.degrees(Q)]
    (cell / "one.csv").write_text("\n".join([",".join(JOINTS), *rows]) + "\n")
    words = ("import", "one.csv", "--rig", "cell.yaml", "--test", "touch", "-o", "one")
    refused = ran(*words, cwd=cell)
    assert refused.returncode == 3
    assert "--socket NAME" in refused.stderr
    assert ran(*words, "--socket", "B", cwd=cell).returncode == 0
    assert set(load_run(cell / "one").table.socket) == {"B"}
    unknown = ran(*words[:-1], "two", "--socket", "C", cwd=cell)
    assert unknown.returncode == 3 and "'C'" in unknown.stderr
