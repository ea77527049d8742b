"""A play is corrected in a program, whose ways are known: judged by a play and an arm apart from the product's."""

from pathlib import Path

import numpy as np
import pytest

from analysis.apps.emulate.pendant import Pendant
from analysis.apps.session.correction_step import corrected_programs
from analysis.apps.session.session_plan import SessionProgram, programs_of_steps, write_programs
from rigs.effects import Backlash, Effect
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.support.session_cell import begun, cell_file
from tests.worlds.arms.faulty_arm import flange_at, found, frame
from tests.worlds.arms.independent_arm import Array
from tests.worlds.interpreters.arms import pose_of

WIDTH_DEG = {1: 0.03, 5: 0.02}


def plays(u_deg: float) -> tuple[Effect, ...]:
    """The plays as they were found, with this standard uncertainty."""
    known = found(width_deg=u_deg)
    return tuple(Backlash(axis=axis, width_deg=width, found=known) for axis, width in WIDTH_DEG.items())


def links_behind(q: Array) -> Array:
    """The links of joints q (n, 6) rad that lag in their plays, one sample after the other."""
    links = q.copy()
    for axis, width_deg in WIDTH_DEG.items():
        half, at = np.radians(width_deg) / 2, q[0, axis - 1]
        for row, joint in enumerate(q[:, axis - 1]):
            at = min(max(at, joint - half), joint + half)
            links[row, axis - 1] = at
    return links


def off_um(rig: Rig, q: Array) -> float:
    """Return the rms distance in µm between tool and circle, without the offset of the circle."""
    circle, tool, base = rig.tests.circle, pose_of(rig.robot.tool), pose_of(rig.robot.base)
    T_tool = frame(tool.place, tool.turn)
    places = np.array([(flange_at(rig, one) @ T_tool)[:3, 3] for one in links_behind(q)])
    from_ball = base.turn.apply(places) + base.place - circle.centre_mm
    radius = np.linalg.norm(from_ball, axis=1)
    on_circle = np.abs(radius - circle.radius_mm) < 1
    phi = np.unwrap(np.arctan2(*(from_ball[on_circle] @ np.linalg.svd(from_ball[on_circle])[2][:2].T).T))
    set_up = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    left = radius[on_circle] - set_up @ np.linalg.lstsq(set_up, radius[on_circle])[0]
    return 1e3 * float(np.sqrt(np.mean(left**2)))


@pytest.mark.parametrize("maker", ["kuka", "ur"])
def test_programs_that_know_a_play_take_most_of_it_away(maker, tmp_path):
    rig, _ = load(cell_file(tmp_path))
    session = begun(tmp_path / "cell.yaml", tmp_path / "session")
    steps = [step for step in session.steps if step.purpose == "find"]
    off = {}
    for what, u_deg in {"known": 0.001, "unsure": 0.02}.items():
        model = rig.model_copy(update={"effects": plays(u_deg)})
        programs = corrected_programs(rig, model, session.stages[:1], steps)
        off[what] = {name: driven(rig, program, maker, tmp_path / what) for name, program in programs.items()}
    nominal = programs_of_steps(rig, session.stages[:1], steps)
    for name, program in nominal.items():
        before = driven(rig, program, maker, tmp_path / "nominal")
        assert before > 50 and off["known"][name] < before / 5
        assert off["unsure"][name] == pytest.approx(before, rel=0.1)


def driven(rig: Rig, program: SessionProgram, maker: MakerName, directory: Path) -> float:
    """Return the distance in µm between tool and circle for a program driven by the controller of a maker."""
    write_programs(maker, [program], directory)
    return off_um(rig, Pendant(rig, directory, maker).trace(program.name).q[::5])
