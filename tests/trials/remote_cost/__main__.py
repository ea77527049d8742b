"""What runs cost that lie in an object store or on an SFTP server: `rig fleet` over the same runs, first and again.

The stores are servers of this computer (moto, asyncssh), so that what a network adds is not in the seconds; processor
time is that of rig alone.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from tests.support.plant_runs import robot_of, write_visits
from tests.support.remote_stores import s3_store, sftp_store

RIG = [sys.executable, "-c", "from analysis.cli import main; main()"]
DAYS = 365.0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev remote_cost", description=__doc__)
    parser.add_argument("--robots", type=int, default=10, help="how many robots (10)")
    parser.add_argument("--visits", type=int, default=20, help="runs of each robot (20)")
    parser.add_argument("--jobs", type=int, default=1, help="processes of rig fleet (1)")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    with tempfile.TemporaryDirectory() as name, ExitStack() as ends:
        work = Path(name)
        plant = work / "plant"
        for number in range(1, given.robots + 1):
            robot = robot_of(number, 0, DAYS)
            for _ in write_visits(plant / robot.name, robot, [float(day) for day in range(given.visits)]):
                pass
        files = [file.stat().st_size for file in plant.rglob("*") if file.is_file()]
        runs = given.robots * given.visits
        print(f"{runs} runs, {len(files) / runs:.1f} files and {sum(files) / runs / 1e3:.1f} kB a run")
        s3, sftp = ends.enter_context(s3_store(plant)), ends.enter_context(sftp_store(plant, work / "keys"))
        places = {"directory": (str(plant), {}), "file://": (f"file://{plant}", {})}
        places |= {"s3://": (s3.url, s3.environment), "sftp://": (sftp.url, sftp.environment)}
        for kind, (place, settings) in places.items():
            for time in ("first", "again"):
                catalogue = str(work / f"{kind.partition(':')[0]}.sqlite")
                words = ["fleet", place, "--catalogue", catalogue, "--jobs", str(given.jobs)]
                print(f"{kind} {time}: {cost_of(words, settings)}", flush=True)
    print(f"load of the computer at the end {os.getloadavg()[0]:.1f}")


def cost_of(words: list[str], settings: dict[str, str]) -> str:
    """Seconds, processor time and peak memory of a command."""
    watch = [sys.executable, str(Path(__file__).parents[1] / "cost_of.py"), *RIG, *words]
    return subprocess.run(
        watch, stdout=subprocess.PIPE, text=True, check=True, env=os.environ | settings
    ).stdout.strip()


if __name__ == "__main__":
    main()
