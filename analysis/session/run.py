"""A session from its command: begun or gone on with, in a cell or an emulated one."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from analysis.session.answer import Inference
from analysis.session.cell import EmulatedHands, Hands, LiveDriver, Person, Rigd, Screen, StartRigd
from analysis.session.correct import CORRECTIONS, entries_file
from analysis.session.guide import Guide, StartInference
from analysis.session.plan import BY_HAND, BY_ITSELF, Pace, planned
from analysis.session.state import Aim, Emulated, Place, Session, Way, digest_of
from daq import clock
from rigs.errors import FileError, UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName


@dataclass(frozen=True)
class Asked:
    """What a person asks for. wait_min: minutes that a robot has to begin; correct: the way that was chosen; entered:
    whether the values of the correction are entered; fast: whether an emulated cell is driven in simulated time."""

    rig_file: str
    aim: Aim
    minutes: float
    maker: MakerName
    emulated: Emulated | None
    operator: str
    wait_min: float
    correct: Way | None = None
    entered: bool = False
    fast: bool = False

    @property
    def pace(self) -> Pace:
        """What the session takes beside the motion; in simulated time as much as with a person."""
        return BY_ITSELF if self.emulated and not self.fast else BY_HAND


@dataclass(frozen=True)
class Means:
    """What a session works with. hands: None for a person, or the emulated cell's own."""

    hands: Hands | None = None
    start_rigd: StartRigd = Rigd.start
    start_inference: StartInference = Inference.start


def run_session(
    rig: Rig,
    text: str,
    place: Place,
    asked: Asked,
    screen: Screen,
    means: Means | None = None,
) -> Session:
    """Begin a session, or go on with the one that is kept, to its end.

    Raises RigError; what was reached is kept, and the same call goes on.
    """
    with place:
        kept = place.read()
        session = kept or _begun(rig, text, asked, screen)
        _hold_same(session, text, asked, place)
        if asked.entered:
            if session.correction is None or session.correction.way != "entries":
                raise UseError("--entered", "this session has no values to be entered", "leave it out")
            session = session.model_copy(update={"correction": session.correction.model_copy(update={"entered": True})})
        if kept is not None:
            which_session = f"of {kept.began}: aim {kept.aim}, {kept.minutes:g} minutes, for {kept.maker}"
            if kept.report:
                screen.say(f"this session is at its end ({which_session}); another begins with another --output")
            else:
                screen.say(f"going on with the session {which_session}")
        place.write(session)
        with _means(session, place, asked) if means is None else nullcontext(means) as equipment:
            hands = equipment.hands or _hands(session, place, screen)
            driver = LiveDriver(
                rig.name, place.directory, hands, screen, asked.operator, asked.wait_min, equipment.start_rigd
            )
            driver.entered = bool(_entered_files(session, place))
            try:
                guide = Guide(
                    place, session, driver, screen, asked.pace, chosen_way=asked.correct,
                    start_inference=equipment.start_inference,
                )  # fmt: skip
                return guide.run()
            finally:
                driver.close()


@contextmanager
def _means(session: Session, place: Place, asked: Asked) -> Iterator[Means]:
    """Give what a session works with, in simulated time where it is asked for."""
    if not (asked.fast and session.emulated):
        yield Means()
        return
    from analysis.session.simulated import (  # noqa: PLC0415 - imports the daemon
        SimulatedCells,
        SimulatedInference,
        simulated_time,
    )

    with simulated_time(session.emulated.seed) as simulated:
        cells = SimulatedCells(simulated, place.directory)
        files = _entered_files(session, place)
        hands = EmulatedHands(place.directory, session.maker, session.emulated, files, cells.start_cell)
        yield Means(hands, cells.start_rigd, SimulatedInference.start)


def _begun(rig: Rig, text: str, asked: Asked, screen: Screen) -> Session:
    screen.show("planning")
    stages, steps = planned(rig, asked.aim, asked.minutes, asked.pace, screen.show)
    return Session(
        rig=rig.name,
        rig_file=asked.rig_file,
        rig_sha256=digest_of(text),
        aim=asked.aim,
        maker=asked.maker,
        minutes=asked.minutes,
        began=clock.wall_time().isoformat(timespec="seconds"),
        emulated=asked.emulated,
        stages=stages,
        steps=steps,
    )


def _hold_same(session: Session, text: str, asked: Asked, place: Place) -> None:
    """Raise an error where the session that is kept is of another cell, or was begun otherwise."""
    if session.rig_sha256 != digest_of(text):
        problem = f"is a session with the rig file {session.rig_file}, which has changed since or is another"
        raise FileError(str(place.file), problem, "restore that file, or begin another session with another --output")
    if (session.emulated is None) != (asked.emulated is None):
        kind = "a real" if session.emulated is None else "an emulated"
        raise UseError("--emulated", f"this session is of {kind} cell", "go on as it was begun, or give another -o")


def _hands(session: Session, place: Place, screen: Screen) -> Hands:
    if session.emulated is None:
        return Person(screen, _confirmed)
    return EmulatedHands(place.directory, session.maker, session.emulated, _entered_files(session, place))


def _entered_files(session: Session, place: Place) -> list[Path]:
    """The files whose values the controller has."""
    correction = session.correction
    return [entries_file(place.directory / CORRECTIONS)] if correction and correction.entered else []


def _confirmed(statement: str) -> bool:
    """Ask a person at the terminal whether something is so; false where there is none."""
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()):
        return False
    try:
        return input(f"{statement}? [y] ").strip().lower() in ("", "y", "yes")
    except EOFError:
        return False
