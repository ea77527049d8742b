"""Rig files and tables of a cell, as docs/rig-file.md and docs/tables.md describe them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from tests.worlds.unknown.arms import Arm, Array
from tests.worlds.unknown.ball import BASELINE_MM, Circle, Hemisphere
from tests.worlds.unknown.cells import BALL_MM, SOCKETS, Cell, runs

SOCKETS_U_MM = 0.02
_GAUGE = (
    "  {name}: {{interface: modbus_map, port: /dev/ttyUSB{k}, line: 57600 8E1, unit: 1, function: 4, address: 200, "
    "count: 13, word_order: little, value: {{address: 202, type: float32}}, offset_mm: {offset}}}\n"
)


def craig_table(arm: Arm) -> list[dict[str, object]]:
    """Axes in modified Denavit-Hartenberg parameters (Craig), where a and alpha of a row lead to its own
    axis.

    Centres of mass are converted to the frame before Tx(a) Rx(alpha) of their own row.
    """
    axes: list[dict[str, object]] = []
    for k in range(arm.axes):
        c, s = np.cos(arm.alpha[k]), np.sin(arm.alpha[k])
        x, y, z = arm.centre[k]
        centre = [x + arm.a[k], c * y - s * z, s * y + c * z]
        axes.append(
            {
                "name": f"axis {k + 1}",
                "limits_deg": [-360.0, 360.0],
                "speed_deg_s": 180.0,
                "a_mm": float(arm.a[k - 1]) if k else 0.0,
                "alpha_deg": float(np.degrees(arm.alpha[k - 1])) if k else 0.0,
                "d_mm": float(arm.d[k]),
                "mass_kg": float(arm.mass[k]),
                "centre_mm": [round(float(value), 3) for value in centre],
            }
        )
    assert arm.a[-1] == arm.alpha[-1] == 0.0
    return axes


def rig_text(arm: Arm, test: str) -> str:
    """Rig file of the nominal arm with the set-up of a test."""
    lines = ["name: cell", "robot:", f"  name: {arm.name}", f"  build: {arm.build}", "  axes:"]
    for axis in craig_table(arm):
        lines.append("    - {" + ", ".join(f"{key}: {value}" for key, value in axis.items()) + "}")
    if test == "circle":
        lines += ["  tool: {xyz_mm: [0, 0, 150], rpy_deg: [0, 90, 0]}", f"  payload_kg: {arm.payload_kg}"]
    return "\n".join([*lines, *_TESTS[test]()]) + "\n"


def _circle_tests() -> list[str]:
    circle, hemisphere = Circle(), Hemisphere()
    gauges = "".join(_GAUGE.format(name=f"g{k + 1}", k=k, offset=o) for k, o in enumerate((25, -25)))
    return [
        "gauges:",
        gauges.rstrip(),
        f"# the gauges stand {BASELINE_MM:.0f} mm apart",
        "feedback: {interface: ur_rtde, port: 'tcp://192.168.1.20:30004', rate_hz: 500}",
        "tests:",
        f"  circle: {{centre_mm: {_list(circle.centre)}, normal: {_list(circle.normal)}, radius_mm: {circle.radius}, "
        f"speed_mm_s: 25, start_deg: 0, lead_deg: 12, posture_deg: {_list(np.degrees(circle.posture))}}}",
        f"  hemisphere: {{centre_mm: {_list(hemisphere.centre)}, radius_mm: {hemisphere.radius}, "
        f"posture_deg: {_list(np.degrees(hemisphere.posture))}}}",
    ]


def _touch_tests() -> list[str]:
    apart = float(np.linalg.norm(SOCKETS["A"] - SOCKETS["B"]))
    return [
        "tests:",
        "  touch:",
        f"    sockets: [{', '.join(SOCKETS)}]",
        f"    ball_mm: {_list(BALL_MM)}",
        "    touches: 60",
        f"    distances: [{{between: [A, B], distance_mm: {apart}, u_mm: {SOCKETS_U_MM}}}]",
    ]


def _list(values: Array) -> list[float]:
    return [round(float(value), 4) for value in values]


_TESTS = {"pose": list, "touch": _touch_tests, "circle": _circle_tests}


def write_cell(cell: Cell, directory: Path) -> list[tuple[Path, str, str]]:
    """Write cell.yaml and a table of each run; return path, test and direction of the tables."""
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "cell.yaml").write_text(rig_text(cell.nominal, cell.test), encoding="utf-8")
    written = []
    for run in runs(cell):
        path = directory / f"{run.name}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(run.columns)
            writer.writerows(zip(*run.columns.values(), strict=True))
        written.append((path, run.test, run.direction))
    return written
