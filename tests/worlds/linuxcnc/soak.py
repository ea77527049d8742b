"""Samples over a long time on a loaded machine, and a controller that is killed and started again.

    python -m tests.worlds.linuxcnc.soak DIRECTORY USER MINUTES

rigd records the joints while processes compute on each core. The program compares the clock of every recorded sample
with its neighbours: a missing servo period is a lost sample, a repeated one an invented sample. The controller itself
states how many periods passed. Then the controller is killed in a run, and started again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from tests.worlds.linuxcnc.person import FAULTS, Person

_BIN = Path(sys.executable).parent
_PERIOD_S = 1e-3
_READY_S = 60.0


def rig(*words: object) -> str:
    """Output of a command of rig."""
    done = subprocess.run([str(_BIN / "rig"), *map(str, words)], capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def robot_columns(run: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Columns of the joints of a recorded run, in order of the recording."""
    tables = [pq.read_table(file) for file in sorted(run.glob("robot-*.parquet"))]
    return {name: np.concatenate([table[name].to_numpy() for table in tables]) for name in tables[0].column_names}


def counted(clock_s: np.ndarray[Any, Any]) -> dict[str, int]:
    """Recorded samples, and the servo periods that are missing or repeated between them."""
    steps = np.rint(np.diff(clock_s) / _PERIOD_S).astype(int)
    restarts = int((steps < -1000).sum())
    forward = steps[steps >= -1000]
    return {
        "samples": len(clock_s),
        "lost": int((forward[forward > 1] - 1).sum()),
        "invented": int((forward < 1).sum()),
        "restarts": restarts,
    }


def start(name: str) -> None:
    """Start a recording, as soon as rigd reads all instruments."""
    until_s = time.monotonic() + _READY_S
    while (shown := rig("record", "start", name, "--test", "yaw", "--direction", "acw")).startswith("error"):
        if time.monotonic() > until_s:
            raise SystemExit(shown)
        time.sleep(1)
    print(shown.strip(), flush=True)


def record(name: str, seconds: float, runs: Path) -> Path:
    start(name)
    time.sleep(seconds)
    rig("record", "stop")
    return next(runs.glob(f"*_{name}"))


def main(directory: Path, user: str, minutes: float) -> int:
    """Run both parts; return 0 if no sample was lost or invented and the killed run is readable."""
    directory.mkdir(parents=True, exist_ok=True)
    person = Person(directory.resolve(), user, FAULTS)
    runs = person.directory / "runs"
    arm = person.prepare()
    log = (person.directory / "rigd.log").open("w")
    rigd = subprocess.Popen([str(_BIN / "rigd"), str(person.rig_file), "--runs", str(runs)], stderr=log)
    loads = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
    try:
        long = record("soak", 60 * minutes, runs)
        load = os.getloadavg()
        print(json.dumps({"minutes": minutes, "load": load, **counted(robot_columns(long)["device_time_s"])}))
        print(rig("verify", long).strip())
        start("killed")
        time.sleep(10)
        person.controller.kill()
        time.sleep(5)
        person.start_controller()
        time.sleep(10)
        rig("record", "stop")
        killed = next(runs.glob("*_killed"))
        print(json.dumps(counted(robot_columns(killed)["device_time_s"])))
        shown = rig("verify", killed)
        print(shown.strip())
        print(rig("analyse", killed).strip()[:600])
        return 0
    finally:
        for process in (*loads, rigd, arm):
            process.terminate()
            process.wait()
        log.close()
        if person.controller is not None:
            person.controller.stop()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])))
