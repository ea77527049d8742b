import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from analysis import save_run, simulate
from tests.support.bench import BIN, Bench
from tests.support.command_line import errors_of, ran, separately, succeeded
from tests.support.live_terminal import Terminal
from tests.support.nightly import cases
from tests.support.recorded_lap import recorded
from tests.support.simulated_laps import lap_run

ROOT = Path(__file__).parents[4]
PORTABLE = [sys.executable, ROOT / "tests" / "portable_child.py", "live"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return lap_run(tmp_path_factory.mktemp("lap"))


def test_a_run_is_played_in_lines_to_its_end(run):
    done = succeeded(f"live --run {run} --speed 64 --plain")
    assert done.stderr == ""
    first, *_, last = done.stdout.splitlines()
    assert float(first.split()[1]) < 10 and last.startswith("at 48.2 s; g1 ") and "reversals" in last
    assert all(line.isprintable() for line in done.stdout.splitlines())


def test_runs_are_played_in_turn_with_overlaid_curves(run, tmp_path):
    done = ran("live", "--run", run, "--run", lap_run(tmp_path, direction="cw"), "--speed", "64", "--json")
    shown = [json.loads(line) for line in done.stdout.splitlines()]
    assert [shown[0]["direction"], shown[-1]["direction"]] == ["acw", "cw"]
    assert shown[0]["recording"] == "yaw-acw-exact" and shown[-1]["reversals"] > 10
    assert shown[0]["band_deg"]["cw"] is None and all(shown[-1]["band_deg"].values())


@pytest.mark.parametrize("option", cases(("--plain", "--json", ""), ("",)))
def test_run_is_played_without_posix(run, option):
    command = [*PORTABLE, "--run", run, "--speed", "64", *option.split()]
    done = separately(*command, timeout=500, cwd=ROOT)
    assert done.returncode == 0 and done.stderr == "" and "yaw" in done.stdout


def test_a_recorded_run_is_played_by_its_aligned_times(tmp_path):
    done = succeeded("live", "--run", recorded(tmp_path), "--speed", "64", "--json")
    assert json.loads(done.stdout.splitlines()[-1])["band_deg"]["acw"] > 0


def test_run_without_motion_is_refused(tmp_path):
    targets = simulate("ur10e-cell", "radial")
    path = save_run(targets, tmp_path / targets.path)
    for run, says in (path, "no motion"), (tmp_path / "nothing", ""):
        (line,) = errors_of(f"live --run {run}").splitlines()
        assert says in line


def test_without_a_daemon_it_is_one_line(tmp_path):
    for options in ((), ("--plain",), ("--json",)):
        done = ran("live", "--rig", "nobody", *options, XDG_RUNTIME_DIR=str(tmp_path))
        assert done.returncode == 4 and len(done.stderr.splitlines()) == 1 and done.stdout == ""


@pytest.mark.parametrize("option", cases(("--plain", "--json"), ("--json",)))
def test_lines_of_a_running_daemon_go_on_until_they_are_stopped(tmp_path, option):
    with Bench(tmp_path) as bench:
        bench.start().all_reading()
        process = subprocess.Popen([BIN / "rig", "live", option], stdout=subprocess.PIPE, env=bench.env, text=True)
        line = next(line for line in process.stdout if "0.1" in line and "g2" in line)
        assert option == "--plain" or json.loads(line)["gauges"]["g1"]["mm"] == pytest.approx(0.1)
        process.send_signal(signal.SIGINT)
        process.stdout.close()
        assert process.wait(300) == 0
        once = bench.run("rig", "live")
        assert once.returncode == 0 and "connected" in once.stdout


def test_no_colour_is_sent_if_unwanted(run):
    for env, coloured in (({}, True), ({"NO_COLOR": "1"}, False)):
        with Terminal([BIN / "rig", "live", "--run", run, "--speed", "64"], 80, 24, env) as terminal:
            terminal.until(lambda text: "ended" in text)
            assert (b"\x1b[1;96m" in terminal.received) == coloured
            terminal.process.send_signal(signal.SIGINT)
            assert terminal.ended() == 0
