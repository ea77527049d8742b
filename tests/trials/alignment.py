"""What errors of alignment do to the figures: the table of docs/setting-up.md, simulated without noise.

A UR10e with a play and a gear wave drives its tests with one thing of the set-up wrong at a time, and the readings are
evaluated as `rig analyse` does, by a rig file that does not know it. The table shows by how much figures change.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from analysis.procedures.results import result_of
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.procedures.simulate import simulate, simulated_run
from analysis.robot.geometry.circle import frame_of, link_readings
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, transform
from analysis.robot.model.predict import model_of, moved
from analysis.runs.tables import CircleTable, Table
from rigs.effects import BallForm, Effect, GaugeBaseline, GaugeInclination
from rigs.load import load, load_hidden
from rigs.rig import Rig
from tests.support.trial import Trial, main, markdown

ROBOT = "ur10e"
TESTS: tuple[Literal["yaw", "roll", "radial"], ...] = ("yaw", "roll", "radial")
FIGURES = (
    ("yaw", "band_deg"),
    ("roll", "band_deg"),
    ("yaw", "circular_deviation_mm"),
    ("yaw", "distance_eccentricity_mm"),
    ("radial", "band_mm"),
    ("radial", "spread_mm"),
    ("radial", "radius_mm"),
)
HEADS = ("yaw band", "roll band", "circular deviation", "eccentricity", "radial band", "radial spread", "radial radius")


@dataclass(frozen=True)
class SetUp:
    """What is wrong: ball less its nominal place (3,) mm, along zero, across and normal; tool's ball less its place on
    the flange (3,) mm, along the tool's axes; effects; the disk's tilt in rad, and whether the link makes half a turn
    in a lap; what is added to the link's length in mm; the rig by which the robot is driven."""

    ball_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    effects: tuple[Effect, ...] = ()
    disk_rad: float = 0.0
    spins: bool = False
    link_mm: float = 0.0
    driven: Callable[[Rig], Rig] = lambda rig: rig


CASES: dict[str, SetUp] = {
    "ball off the centre by 1 mm, in the plane of the circle": SetUp(ball_mm=(1.0, 0.0, 0.0)),
    "ball off the centre by 1 mm, along the normal": SetUp(ball_mm=(0.0, 0.0, 1.0)),
    "ball out of round by 0.01 mm, three lobes": SetUp(effects=(BallForm(lobes=3, amplitude_mm=0.005),)),
    "disk 1° from square, the link not spinning": SetUp(disk_rad=np.radians(1.0)),
    "disk 0.1° from square, the link making half a turn in a lap": SetUp(disk_rad=np.radians(0.1), spins=True),
    "gauge 1 inclined by 5°": SetUp(effects=(GaugeInclination(gauge="g1", angle_deg=5.0),)),
    "gauges 1 mm further apart than the rig file says": SetUp(effects=(GaugeBaseline(delta_mm=1.0),)),
    "tool's ball 1 mm to the side of where robot.tool has it": SetUp(tool_mm=(0.0, 1.0, 0.0)),
    "circle driven with a radius 1 mm larger than in the rig file": SetUp(
        driven=lambda rig: _with_circle(rig, radius_mm=circle_of(rig).radius_mm + 1)
    ),
    "circle driven 1 mm beside that of the rig file, about the ball": SetUp(
        driven=lambda rig: _with_circle(rig, centre_mm=tuple(np.add(circle_of(rig).centre_mm, _across(rig)))),
    ),
    "link 0.1 mm longer than it was set to": SetUp(link_mm=0.1),
}


Row = tuple[str, dict[tuple[str, str], float]]


def draw(given: Namespace) -> Iterable[tuple[str, SetUp]]:
    return {"aligned": SetUp(), **CASES}.items()


def judged(case: tuple[str, SetUp]) -> Row:
    return case[0], figures_of(case[1])


def report(rows: Sequence[Row]) -> str:
    """The table of docs/setting-up.md."""
    (what, aligned), *others = rows
    lines = [[what, *(_value(name, aligned[test, name]) for test, name in FIGURES)]]
    for words, found in others:
        lines.append([words, *(_change(name, found[test, name] - aligned[test, name]) for test, name in FIGURES)])
    return markdown(["", *HEADS], lines)


def figures_of(setup: SetUp) -> dict[tuple[str, str], float]:
    rig, text = load(ROBOT)
    hidden = load_hidden(ROBOT).apply_to(rig)
    found = {}
    for test in TESTS:
        direction = None if test == "radial" else "acw"
        run = simulated_run(hidden, text, test, direction, None)
        result = result_of(replace(run, table=_measured(setup, hidden, test)))
        found |= {(test, name): figure.value for name, figure in result.figures.items()}
    return found


def _measured(setup: SetUp, rig: Rig, test: Literal["yaw", "roll", "radial"]) -> Table:
    """What the gauges read while the robot drives its program with this set-up."""
    driven = setup.driven(rig)
    program = simulate(driven, test, None if test == "radial" else "acw", None)
    tool = driven.robot.tool.model_copy(
        update={"xyz_mm": tuple(np.add(driven.robot.tool.xyz_mm, _turned(driven, setup.tool_mm)))}
    )
    actual = driven.model_copy(update={"robot": driven.robot.model_copy(update={"tool": tool})})
    model = model_of(actual, (*rig.effects, *setup.effects))
    path = path_of(model, program)
    nominal = nominal_setup(driven, program)
    frame = frame_of(circle_of(rig))
    off = np.array(setup.ball_mm) @ np.stack([frame.u, frame.v, frame.n])
    if isinstance(program, CircleTable):
        off = off + np.array(circle_of(rig).eccentricity_mm)
    values = predict(model, program, path, replace(nominal, ball=nominal.ball + off)) + setup.link_mm
    if setup.disk_rad and isinstance(program, CircleTable):
        T = moved(model, path).T[path.rows]
        around = frame.angle(T[:, :3, 3]) / 2 if setup.spins else np.full(len(T), np.pi / 4)
        square = [
            link_readings(one, nominal.ball + off, np.array([25.0, -25.0]), program.test, frame.radius)
            for one in (T, T @ _tilts(setup.disk_rad, around))
        ]
        values = values + square[1] - square[0]
    return program.with_readings(values)


def _tilts(tilt: float, around: Array) -> Array:
    """Frames (n, 4, 4) of a disk tilted by so many rad about axes across its link, at angles (n,) rad around it."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415

    axis = np.stack([np.cos(around), np.sin(around), np.zeros(len(around))], axis=1)
    T = np.tile(np.eye(4), (len(around), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(tilt * axis).as_matrix()
    return T


def _turned(rig: Rig, offset_mm: tuple[float, float, float]) -> Array:
    """An offset (3,) mm along the tool's axes, in those of the flange."""
    return np.asarray(transform(rig.robot.tool)[:3, :3] @ np.array(offset_mm))


def _across(rig: Rig) -> Array:
    return frame_of(circle_of(rig)).u


def _with_circle(rig: Rig, **update: Any) -> Rig:
    circle = circle_of(rig).model_copy(update=update)
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": circle})})


def _value(name: str, value: float) -> str:
    return f"{value:.4f}°" if name.endswith("_deg") else f"{value:.4f} mm"


def _change(name: str, change: float) -> str:
    least = 0.00005
    if abs(change) < least:
        return "–"
    return f"{change:+.4f}°" if name.endswith("_deg") else f"{change:+.4f} mm"


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: "",
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
