"""Drawn programs of five dialects, corrected, and driven before and after by interpreters that share nothing with the
reader: what the correction changed is where the text wants it, and what it did not change is listed."""

from collections import Counter
from importlib.util import find_spec

import pytest

from tests.support.nightly import cases
from tests.trials.programs.trial import grave, judge, story
from tests.worlds.languages.arms import DIALECTS, choose_controller
from tests.worlds.languages.grammars import draw

_FOLLOWS = find_spec("analysis.apps.makers.program_machine") is not None
"""Whether the reader follows the state of a program on every way."""
_DRAWN, _PLAIN, _AT_NIGHT = 10, 8, 400
_PARTS = [(dialect, part) for part in range(_AT_NIGHT // _DRAWN) for dialect in DIALECTS]


@pytest.mark.skipif(not _FOLLOWS, reason="no tools")
@pytest.mark.parametrize(("dialect", "part"), cases(_PARTS, lambda one: one[1] == 0))
def test_no_target_is_farther_off_unless_it_is_listed(dialect, part):
    for seed in range(part * _DRAWN, (part + 1) * _DRAWN):
        verdict = judge(draw(dialect, seed, plain=False))
        assert not verdict.error, (seed, verdict.error)
        assert not [fault for fault in verdict.faults if grave(fault)], (seed, story(verdict))


@pytest.mark.skipif(not _FOLLOWS, reason="no tools")
@pytest.mark.parametrize("dialect", DIALECTS)
def test_plain_programs_are_corrected(dialect):
    verdicts = [judge(draw(dialect, seed, plain=True)) for seed in range(_PLAIN)]
    assert not [story(verdict) for verdict in verdicts if verdict.faults]
    assert sum(verdict.moved for verdict in verdicts) >= 0.95 * sum(verdict.asked for verdict in verdicts) > 0


@pytest.fixture
def controller(request):
    choose_controller(request.param)
    yield request.param
    choose_controller("data_sheet")


@pytest.mark.parametrize("controller", ["stated", "added", "unknown"], indirect=True)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_controllers_with_own_constants_get_no_target_farther_off(dialect, controller):
    plain = [judge(draw(dialect, seed, plain=True)) for seed in range(4)]
    verdicts = plain + [judge(draw(dialect, seed, plain=False)) for seed in range(4)]
    assert not [story(one) for one in verdicts if one.error or any(map(grave, one.faults))]
    reasons = Counter(why for one in plain if one.corrected for _, why in one.corrected.left)
    if controller == "unknown":
        assert reasons["controller_unknown"] > 3
    else:
        assert sum(one.moved for one in plain) >= 0.8 * sum(one.asked for one in plain) > 0
        assert not reasons["controller_unknown"]


def test_a_program_has_every_way():
    """A loop is passed none, one and two times, a branch both ways, and a routine without text does two things."""
    from tests.worlds.languages import urscript  # noqa: PLC0415
    from tests.worlds.languages.execution import World, every_way  # noqa: PLC0415

    move = "movej([0, -1, 1, 0, 1, 0])"
    text = f"def a():\n while x > 1:\n  {move}\n end\n if y:\n  {move}\n end\n pick()\nend\n"
    program, seen = urscript.Program({"a.script": text}, "a.script"), set()
    for ways in every_way(40, 0):
        machine = urscript.Machine(program, World(0), ways)
        machine.run()
        seen.add((tuple(one.place[1] for one in machine.robot.reached), tuple(ways.taken[-1:])))
    loops = [(3,) * k for k in range(3)]
    assert seen == {(loop + end, (last,)) for loop in loops for end in ((), (6,)) for last in (0, 1)}
