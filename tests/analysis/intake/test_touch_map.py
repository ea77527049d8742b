from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from analysis.api import load_run, save_run, simulate
from rigs.load import SHIPPED
from tests.support.command_line import ran

JOINTS = [f"J{axis}" for axis in range(1, 7)]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("touches")
    data = yaml.safe_load((SHIPPED / "ur10e.yaml").read_text(encoding="utf-8"))
    data["tests"] = {"touch": {"sockets": ["A", "B"], "ball_mm": [0, 0, 90], "touches": 12}}
    (folder / "cell.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    save_run(simulate(folder / "cell.yaml", "touch"), folder / "exact")
    return folder


def written(cell: Path, name: str, header: list[str], *, socket: bool, factor: float = 1.0) -> None:
    table = load_run(cell / "exact").table
    rows = [",".join([*(["socket"] if socket else []), *header])]
    for name_of_socket, q in zip(table.socket, np.degrees(table.q) * factor, strict=True):
        rows.append(",".join([*([str(name_of_socket)] if socket else []), *map(str, q)]))
    (cell / name).write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.mark.parametrize(("header", "factor"), [(JOINTS, 1.0), ([f"joint_{axis}" for axis in range(6)], np.pi / 180)])
def test_joints_of_touches_are_read_under_the_names_of_a_pendant(cell, header, factor):
    name = f"touches-{header[0]}"
    written(cell, f"{name}.csv", header, socket=True, factor=factor)
    done = ran("import", f"{name}.csv", "--rig", "cell.yaml", "--test", "touch", "-o", name, cwd=cell)
    assert done.returncode == 0, done.stderr
    imported, exact = load_run(cell / name).table, load_run(cell / "exact").table
    assert np.allclose(imported.q, exact.q) and (imported.socket == exact.socket).all()


def test_one_socket_for_all_rows_is_an_option(cell):
    written(cell, "one.csv", JOINTS, socket=False)
    words = ("import", "one.csv", "--rig", "cell.yaml", "--test", "touch", "-o", "one")
    refused = ran(*words, cwd=cell)
    assert refused.returncode == 3
    assert "--socket NAME" in refused.stderr
    assert ran(*words, "--socket", "B", cwd=cell).returncode == 0
    assert set(load_run(cell / "one").table.socket) == {"B"}
    unknown = ran(*words[:-1], "two", "--socket", "C", cwd=cell)
    assert unknown.returncode == 3 and "'C'" in unknown.stderr


def test_touches_report_the_value_of_a_socket_distance(cell):
    told = ran("analyse", "exact", cwd=cell)
    assert "unknown" in " ".join((told.stdout + told.stderr).split())
