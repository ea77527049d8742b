"""Guided movement check: propose a touch, take it, and update the odds until a cause is named."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from analysis.apps.commission.joint_samples import SampleSource
from analysis.apps.commission.movement_report import headline, what_to_do
from analysis.apps.commission.record_touches import TONE, guided_joints, write_touches
from analysis.apps.commission.touched_ball import is_same_posture
from analysis.apps.commission.what_moved import MovementResult, moved_of, study_runs
from analysis.diagnosis.evidence.observation import ObservedRun, by_socket, observe, socket_of, with_placement
from analysis.movement.inference import MOST_MM, Reference, compare
from analysis.movement.linearise import tool_places
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from analysis.runs.tables import TouchTable
from daq import clock
from daq.store import MovementCheck, mark_moved
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class GuidedCheck:
    rig: Rig
    rig_text: str
    placement: str
    names: tuple[str, ...]
    """Runs of the reference."""
    reference: Reference
    sockets: Mapping[str, Array]
    """Place of the ball (3,) in mm, by set-up."""
    touches: tuple[tuple[str, Array], ...] = ()
    """Socket and joint angles (axes,) in rad of each touch."""

    @classmethod
    def of_runs(cls, runs: Sequence[Measured], rig: Rig | None = None) -> GuidedCheck:
        """A check that has no touches yet. All touches of the reference runs must have the same placement.

        rig: model of the arm, by default that of the first run.
        """
        touched = [run for run in runs if run.table.test == "touch"]
        names = tuple(run.run.manifest.name for run in runs)
        placements = {run.run.manifest.placement for run in touched}
        if len(placements) != 1:
            problem = f"has touches of {len(placements)} placements, but a guided check needs those of one"
            remedy = "give runs of touches of the same sockets"
            raise FileError(", ".join(names), problem, remedy, code="readings.unsuitable")
        reference = study_runs(rig or runs[0].rig, runs)
        place = reference.place
        sockets = {
            run.setup: tool_places(run, place.setups[run.setup]).mean(axis=0)
            for run in reference.runs
            if socket_of(run.setup)
        }
        text = touched[0].run.manifest.rig_text
        return cls(rig or runs[0].rig, text, placements.pop(), reference.names, reference, sockets)

    def with_touch(self, q: Array) -> GuidedCheck:
        """Check with a touch at joint angles (axes,) rad, in the socket nearest to the ball."""
        place, distances = self.reference.place, dict[str, float]()
        for setup, centre in self.sockets.items():
            (run,) = self._observed([socket_of(setup)], q[None])
            ball = tool_places(replace(run, model=place.model), place.setups[setup])[0]
            distances[setup] = float(np.linalg.norm(ball - centre))
        setup = min(distances, key=distances.__getitem__)
        if distances[setup] > MOST_MM:
            problem = f"the ball is {distances[setup]:.0f} mm from socket {socket_of(setup)}, the nearest one"
            raise FileError("touch", problem, "seat the ball in a socket of the reference", code="readings.unsuitable")
        return replace(self, touches=(*self.touches, (socket_of(setup), q)))

    def _observed(self, sockets: Sequence[str], q: Array) -> list[ObservedRun]:
        table = TouchTable(np.array(sockets), q)
        return by_socket(with_placement(observe(self.reference.place.model, table, "new touches"), self.placement))

    @cached_property
    def result(self) -> MovementResult:
        if not self.touches:
            return moved_of(self.reference, None, plan=True)
        runs = self._observed([socket for socket, _ in self.touches], np.array([q for _, q in self.touches]))
        return moved_of(self.reference, compare(self.reference, runs), plan=True)

    @property
    def is_decided(self) -> bool:
        """True if a cause is named, or no further touch would help."""
        return bool(self.touches) and (self.result.named is not None or self.result.next_posture is None)

    def save(self, directory: Path, operator: str) -> Path:
        if not self.touches:
            raise FileError(str(directory), "no touch was taken", "seat the ball in a socket", code="readings.too_few")
        sockets, q = (np.array(part) for part in zip(*self.touches, strict=True))
        source = f"movement check against {', '.join(self.names)}"[:200]
        table = TouchTable(sockets, q)
        write_touches(directory, table, self.rig, self.rig_text, operator, source, self.placement)
        mark_moved(directory, mark_of(self.result, self.names))
        return directory


def mark_of(result: MovementResult, names: Sequence[str]) -> MovementCheck:
    likeliest, named = result.causes[0], result.named
    return MovementCheck(
        at=clock.wall_time().isoformat(timespec="seconds"), reference=tuple(names), what=named.what if named else "",
        axis=named.cause.axis if named else None, name=named.name if named else "", probability=likeliest.posterior,
        answer=headline(result),
    )  # fmt: skip


def follow_touches(daemon: SampleSource, check: GuidedCheck, say: Callable[[str], None]) -> GuidedCheck:
    """Take each touch until the check is decided, or Ctrl-C.

    The posture at the start is no touch: the robot may have stood there since before the movement.
    """
    say("Seat the ball near the posture, let go, and wait for the tone. Ctrl-C ends the check and keeps the touches.")
    say(what_to_do(check.result))
    last, has_left = np.empty(0), False
    with suppress(KeyboardInterrupt):
        for q_deg, came_deg in guided_joints(daemon, len(check.rig.robot.axes)):
            last = last if last.size else q_deg
            has_left = has_left or not is_same_posture(q_deg, last)
            if came_deg is None or not has_left:
                continue
            try:
                check = check.with_touch(np.radians(q_deg))
            except FileError as error:
                say(f"{error.what}: {error.remedy}")
                continue
            last, has_left = q_deg, False
            say(f"{TONE}touch {len(check.touches)}: {headline(check.result)}")
            if check.is_decided:
                return check
            say(what_to_do(check.result))
    return check
