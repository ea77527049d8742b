"""Drawn programs of five dialects, corrected, and driven before and after by interpreters that share nothing with the
reader: what the correction changed is where the text wants it, and what it did not change is listed."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.support.nightly import cases
from tests.trials.programs.trial import Corrected, correct, grave, judge, story
from tests.worlds.languages.arms import DIALECTS, choose_controller, frame
from tests.worlds.languages.drawing import Draft
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
def controller(request: pytest.FixtureRequest) -> Iterator[str]:
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


def _kinds(dialect: str, correction: Callable[[Draft], Corrected]) -> Counter[str]:
    drafts = [draw(dialect, seed, plain=True) for seed in range(6)]
    return Counter(fault.kind for draft in drafts for fault in judge(draft, correction).faults)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_correction_in_another_tool_and_frame_is_seen(dialect):
    away = frame((40.0, -30.0, 60.0), Rotation.from_euler("xyz", [0.1, -0.1, 2.0]))

    def wrong(draft: Draft) -> Corrected:
        told = {key: T @ away for key, T in (draft.tools or {"tcp": np.eye(4)}).items()}
        frames = {key: away @ T for key, T in draft.frames.items()}
        return correct(replace(_with_stated(draft), tools=told, frames=frames))

    def _with_stated(draft: Draft) -> Draft:
        if dialect not in ("ur", "abb", "kuka"):
            return draft
        pattern = {"ur": rb"set_tcp\(p\[", "abb": rb"tooldata \w+:=\[TRUE,\[\[", "kuka": rb"\$TOOL=\{(?:FRAME: )?X "}[
            dialect
        ]
        files = {name: re.sub(pattern + rb"-?", lambda one: one[0] + b"1", data) for name, data in draft.files.items()}
        return replace(draft, files=files)

    def numbers_of(draft: Draft) -> Corrected:
        made = wrong(draft)
        kept = _with_stated(draft).files
        files = {}
        for name, data in draft.files.items():
            rows, told, new = (one.split(b"\n") for one in (data, kept[name], made.files[name]))
            files[name] = b"\n".join(a if b == c else c for a, b, c in zip(rows, told, new, strict=True))
        return replace(made, files=files)

    kinds = _kinds(dialect, numbers_of)
    assert kinds["short"] + kinds["farther off"] + kinds["another posture"] + kinds["another way"] > 0, kinds


def _of(dialect: str, change: Callable[[bytes], bytes]) -> Counter[str]:
    def changed(draft: Draft) -> Corrected:
        made = correct(draft)
        return replace(made, files={name: change(data) for name, data in made.files.items()})

    return _kinds(dialect, changed)


_POINT = {
    "ur": (rb"(movel\(p\[)-?\d*\.(\d)", rb"\g<1>0.\g<2>"),
    "kuka": (rb"(\{X |\{E6POS: X |\{POS: X )\d", rb"\g<1>4"),
    "abb": (rb"(robtarget \w+:=\[\[)\d\d", rb"\g<1>41"),
    "fanuc": (rb"X = +(\d+)", lambda one: b"X = " + str(int(one[1]) + 3).encode()),
    "yaskawa": (rb"(C0000\d=\d)(\d)", lambda one: one[1] + str((int(one[2]) + 1) % 10).encode()),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_point_elsewhere_is_seen(dialect):
    kinds = _of(dialect, lambda data: re.sub(*_POINT[dialect], data))
    assert kinds["farther off"] + kinds["another posture"] + kinds["another way"] > 0, kinds


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_changed_letter_is_seen(dialect):
    assert _of(dialect, lambda data: data.replace(b"O", b"o").replace(b"e", b"E"))["bytes"] >= 6


@pytest.mark.parametrize("dialect", DIALECTS)
def test_unlisted_unchanged_targets_are_detected(dialect):
    kinds = _kinds(dialect, lambda draft: Corrected(draft.files, frozenset(), (), 0.04, frozenset(draft.files)))
    assert kinds["silent"] > 6, kinds


@pytest.mark.parametrize("dialect", DIALECTS)
def test_listed_changed_targets_are_detected(dialect):
    def listed(draft: Draft) -> Corrected:
        made = correct(draft)
        rows = {
            (name, k)
            for name, data in draft.files.items()
            for k, pair in enumerate(zip(data.splitlines(), made.files[name].splitlines(), strict=True), start=1)
            if pair[0] != pair[1]
        }
        return replace(made, done=frozenset(), left=tuple((place, "computed") for place in rows))

    assert _kinds(dialect, listed)["left, yet changed"] > 6


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
