from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import load_run
from analysis.apps.commission.record_touches import TONE, record_touches
from analysis.procedures.results import result_of
from analysis.procedures.simulate import planned_touches
from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from rigs.errors import CellError
from rigs.load import parse
from rigs.rig import Rig
from tests.analysis.apps.commission.test_touching import EVERY_S, guided
from tests.support.refusals import refused

TEXT = f"name: cell\n{load_arm('ur5').text}tests: {{touch: {{sockets: [A, B], touches: 12}}}}\n"


@pytest.fixture(autouse=True)
def proposals(monkeypatch):
    """Number of touches and socket of each proposal, which takes a second."""
    proposed = list[tuple[int, str]]()

    def propose(_: Rig, touches: TouchTable, socket: str) -> None:
        proposed.append((len(touches.q), socket))

    monkeypatch.setattr("analysis.apps.planning.next_reading.next_touch", propose)
    return proposed


class Served:
    def __init__(self, touches: int = 12, end: BaseException | None = None) -> None:
        self._end = end or KeyboardInterrupt()
        planned = planned_touches(parse(TEXT, "cell.yaml"))
        self.planned = planned
        rows = guided(planned.q[:touches], planned.came_from[:touches])
        columns = [f"q{axis}_deg" for axis in range(1, 7)]
        every = [[int(1e9 * EVERY_S * k), *row] for k, row in enumerate(rows.tolist())]
        self._robot = {"rows": every, "columns": columns, "newest": len(every)}

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        assert command == "samples"
        if "rig" in fields:
            return {"rig_lines": TEXT.splitlines(), "streams": {}}
        if fields["after"]:
            raise self._end
        return {"streams": {"robot": self._robot}}


def record(served: Served, folder: Path, say: Callable[[str], None] = print, placement: str = "") -> Path:
    return record_touches(served, "monday", folder / "monday", "ada", placement, None, say)


def test_the_touches_of_a_person_are_a_run(tmp_path, proposals):
    served, said = Served(), list[str]()
    run = record(served, tmp_path, said.append, "left")
    assert sum(line.startswith(TONE) for line in said) == 12
    assert proposals == [*((count, "A") for count in range(1, 6)), *((count, "B") for count in range(7, 12))]
    found = load_run(run)
    told = found.run.manifest
    assert (told.test, told.placement, told.operator) == ("touch", "left", "ada")
    planned = served.planned
    np.testing.assert_allclose(found.table.q, planned.q, atol=1e-9)
    assert found.table.socket.tolist() == planned.socket.tolist()
    sides = np.sign(found.table.q - found.table.came_from)  # the direction of each joint
    np.testing.assert_array_equal(sides, np.sign(planned.q - planned.came_from))
    assert result_of(found).figures["rms_mm"].value < 1e-4


def test_ending_early_keeps_finished_touches(tmp_path):
    run = record(Served(8), tmp_path)
    assert len(load_run(run).table.q) == 8


def test_a_robot_that_falls_silent_takes_no_touch_along(tmp_path):
    said, silent = list[str](), CellError("robot", "no joints", "wait")
    with pytest.raises(CellError):
        record(Served(8, silent), tmp_path, said.append)
    assert str(tmp_path / "monday") in said[-1] and len(load_run(tmp_path / "monday").table.q) == 8


def test_too_few_touches_are_not_kept(tmp_path):
    with refused("readings.too_few", "touches were made"):
        record(Served(3), tmp_path)
    assert not (tmp_path / "monday").exists()
