"""Touches of a pointer in a punch mark: its own scatter is no unknown error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from analysis.api import save_run, simulate
from analysis.runs.loading import load_measured
from rigs.arms import load_arm
from tests.support.command_line import ran
from tests.support.drawn_tables import Array, constants
from tests.support.nightly import cases
from tests.worlds.arms.independent_arm import flange, none

CELLS = [("ur10e", 3, 0.045), ("ur10e", 2, 0.06), ("fanuc-lr-mate-200id", 3, 0.05), ("abb-irb-120", 3, 0.045),
         ("kuka-kr-6-r900-2", 2, 0.07)]  # fmt: skip


def beside_the_mark(arm: str, q: Array, sd_mm: float, rng: np.random.Generator) -> Array:
    """Joint angles of touches that miss the mark by a scatter in each direction."""

    def tip(joints: Array) -> Array:
        R, p = flange(constants(arm), none(), joints)
        return p + R @ np.array([0.0, 0.0, 90.0])

    J = np.stack([(tip(q + 1e-6 * step) - tip(q)) / 1e-6 for step in np.eye(6)], axis=2)
    return q + np.einsum("nij,nj->ni", np.linalg.pinv(J), rng.normal(0, sd_mm, (len(q), 3)))


@pytest.mark.cpu_limit(300)
@pytest.mark.parametrize(("arm", "axis", "sd_mm"), cases(CELLS, CELLS[:1]))
def test_the_zero_is_named_and_not_the_scatter_of_the_tip(arm: str, axis: int, sd_mm: float, tmp_path: Path) -> None:
    sections = yaml.safe_load(load_arm(arm).text)
    touch = {"sockets": ["A", "B"], "ball_mm": [0, 0, 90], "touches": 60, "seat": "tip"}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump({"name": "cell", **sections, "tests": {"touch": touch}}))
    effects = {"effects": [{"effect": "joint_offset", "axis": axis, "offset_deg": 0.3}]}
    (tmp_path / "hidden.yaml").write_text(yaml.safe_dump(effects))
    run = simulate(tmp_path / "cell.yaml", "touch", seed=None, effects=str(tmp_path / "hidden.yaml"))
    save_run(run, tmp_path / "exact")
    table = load_measured(tmp_path / "exact").table
    q = beside_the_mark(arm, table.q, sd_mm, np.random.default_rng([axis, len(arm)]))
    rows = [
        ",".join([socket, *map(str, row)]) for socket, row in zip(table.socket, np.degrees(q).tolist(), strict=True)
    ]
    header = ",".join(["socket", *(f"q{k}_deg" for k in range(1, 7))])
    (tmp_path / "touches.csv").write_text("\n".join([header, *rows]) + "\n")
    done = ran("diagnose", "touches.csv", "--rig", "cell.yaml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["unexplained"] is None or found["unexplained"].get("unrepeated_um") is None
    named = {name["name"] for name in found["effects"] if name["stands"]}
    assert named <= {f"joint_offset {axis}"}
    assert named or arm == "abb-irb-120"  # these touches move its axis 3 too little to tell it from an angle scale
