"""`rig session --emulated`, with hands at the cell that make mistakes: for `scripts/dev sessions` alone."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from analysis.cli.console import say, say_error
from analysis.session.cell import EmulatedHands
from analysis.session.correct import CORRECTIONS, entries_file
from analysis.session.plan import Program
from analysis.session.run import Asked, run_session
from analysis.session.state import Emulated, Place
from rigs.errors import RigError
from rigs.load import load


class TroubledHands(EmulatedHands):
    """Does at a given start of a program what a person may do; `troubles`: the trouble of each start, from 0."""

    def __init__(self, directory: Path, asked: Asked, troubles: dict[int, str]) -> None:
        assert asked.emulated is not None
        kept = Place(directory).read()
        entered = kept is not None and kept.correction is not None and kept.correction.entered
        files = [entries_file(directory / CORRECTIONS)] if entered else []
        super().__init__(directory, asked.maker, asked.emulated, files)
        self._troubles, self._file = troubles, directory / "starts.txt"
        self._later: list[tuple[float, str]] = []

    def start(self, program: Program) -> None:
        number = int(self._file.read_text()) if self._file.exists() else 0
        self._file.write_text(str(number + 1))
        trouble, now_s = self._troubles.get(number, ""), time.monotonic()
        self._later = []
        match trouble:
            case "late":
                self._later = [(now_s + 20, f"run {program.name}")]
            case "other":
                others = [p.stem for p in sorted((self._directory / "programs" / program.stage).glob("*.*"))]
                mine = program.name.replace("-", "_")
                wrong = next((one for one in others if one.lower() != mine.lower()), mine)
                super().start(program)
                self._waits = False
                self._later = [(now_s + 1, "stop"), (now_s + 3, f"run {wrong}")]
            case "stop":
                super().start(program)
                self._later = [(now_s + 10, "stop")]
            case "pause":
                super().start(program)
                self._later = [(now_s + 9, "pause"), (now_s + 11, "go on")]
            case "twice":
                super().start(program)
                self._later = [(now_s + 2, f"run {program.name}")]
            case _:
                super().start(program)

    def look(self) -> None:
        now_s = time.monotonic()
        for line in [line for at_s, line in self._later if at_s <= now_s]:
            self._type(line)
        self._later = [one for one in self._later if one[0] > now_s]
        super().look()


def main() -> None:
    request = json.loads(Path(sys.argv[1]).read_text())
    rig, text = load(request["rig"])
    directory = Path(request["directory"])
    asked = Asked(
        rig_file=request["rig"],
        aim="faults",
        minutes=request["minutes"],
        maker=request["maker"],
        emulated=Emulated(effects=request["effects"], seed=request["seed"]),
        operator="trial",
        wait_min=1.5,
    )

    class Lines:
        def say(self, line: str) -> None:
            say(f"{time.strftime('%H:%M:%S')} {line}")
            sys.stdout.flush()

        def show(self, line: str) -> None:
            """Nothing is rewritten in a log."""

    troubles = {int(number): trouble for number, trouble in request["troubles"].items()}
    try:
        run_session(rig, text, Place(directory), asked, Lines(), TroubledHands(directory, asked, troubles))
    except RigError as error:
        say_error(error)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
