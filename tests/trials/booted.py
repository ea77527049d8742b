"""The shipped service under a real systemd: installed, started, hung and restarted by the watchdog, removed. As root.

systemd is booted as the first process of namespaces of its own, on an overlay of this computer's Debian: nothing here
is changed, there is no network, and all of it is gone at the end. `scripts/install` puts rig in before (that needs
the network), with Debian's own Python. Needs root, systemd and a cgroup2 mount; says what is missing in one line.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

SOURCE = Path(__file__).parents[3]
SOURCE_INSIDE = Path("/opt/source")
PATIENCE_S = 90.0
CELL = "paper-fanuc"
_T = TypeVar("_T")
_BOOT = """
set -eu
for kind in null zero full random urandom tty; do touch $0/dev/$kind; mount --bind /dev/$kind $0/dev/$kind; done
mount -t proc proc $0/proc
mount --bind $0/proc/sys $0/proc/sys && mount -o remount,bind,ro $0/proc/sys
mount -t sysfs -o ro sysfs $0/sys
mount -t tmpfs tmpfs $0/sys/fs
mkdir $0/sys/fs/cgroup
mount -t cgroup2 cgroup2 $0/sys/fs/cgroup
mkdir $0/dev/pts
mount -t devpts -o newinstance,ptmxmode=0666,mode=620,gid=5 devpts $0/dev/pts
ln -s pts/ptmx $0/dev/ptmx
for folder in run tmp var/tmp dev/shm; do mkdir -p $0/$folder; mount -t tmpfs -o mode=1777 tmpfs $0/$folder; done
chmod 755 $0/run
exec env -i container=namespaces PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot $0 \\
    /lib/systemd/systemd --unit=basic.target --log-target=journal --show-status=0
"""
_INSTALL = """
set -eu
echo $$ >"$3"
mount --make-rprivate /
mount -t tmpfs tmpfs $0
mkdir $0/upper $0/work $0/root
mount -t overlay overlay -o lowerdir=/,upperdir=$0/upper,workdir=$0/work $0/root
mount -t tmpfs -o mode=755 tmpfs $0/root/dev
touch $0/root/dev/null; mount --bind /dev/null $0/root/dev/null
rm -rf $0/root/etc/rig $0/root/opt/rig
mkdir $0/root/opt/source
(cd "$1" && cp -r --parents scripts systemd rigs daq analysis pyproject.toml README.md LICENSE $0/root/opt/source)
chroot $0/root /opt/source/scripts/install
useradd --root $0/root --no-create-home --groups rig anna
: >$0/root/etc/machine-id
exec unshare --pid --fork --kill-child --uts --ipc --cgroup --net --mount bash -c "$2" $0/root
"""


class Missing(Exception):
    """This computer cannot boot a systemd of its own."""


class Machine:
    """A booted systemd; commands run in it."""

    def __init__(self, folder: Path, cgroup: Path) -> None:
        self._cgroup = cgroup
        self._process = subprocess.Popen(
            ["unshare", "--mount", "bash", "-c", _INSTALL, folder, SOURCE, _BOOT, cgroup / "cgroup.procs"],
        )
        try:
            self._pid = until(self._first_process, "systemd to boot", 600)
            until(lambda: self.run("systemctl", "is-active", "basic.target").stdout == "active\n", "basic.target")
        except BaseException:
            self.stop()
            raise

    def run(self, *command: str | Path, user: str = "", check: bool = False) -> subprocess.CompletedProcess[str]:
        """To its end, as root or another user."""
        enter = ["nsenter", f"--target={self._pid}", "--all", "--root", "--wd"]
        drop = ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups"] if user else []
        done = subprocess.run(
            [*enter, *drop, *command], capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
        if check and done.returncode:
            raise AssertionError(f"{' '.join(map(str, command))}: {done.returncode}: {done.stdout}{done.stderr}")
        return done

    def shows(self, unit: str, name: str) -> str:
        return self.run("systemctl", "show", "--value", f"--property={name}", unit).stdout.strip()

    def stop(self) -> None:
        """Kill all processes of the machine and delete its control group."""
        self._process.kill()
        self._process.wait()
        (self._cgroup / "cgroup.kill").write_text("1")
        until(
            lambda: self._cgroup / "cgroup.events" and "populated 0" in (self._cgroup / "cgroup.events").read_text(),
            "end",
        )
        for folder in sorted((p for p in self._cgroup.rglob("*") if p.is_dir()), reverse=True):
            folder.rmdir()
        self._cgroup.rmdir()

    def _first_process(self) -> int | None:
        if self._process.poll() is not None:
            raise Missing(f"installing or booting ended with exit code {self._process.returncode}")
        for pid in (self._cgroup / "cgroup.procs").read_text().split():
            with contextlib.suppress(OSError):
                if Path(f"/proc/{pid}/comm").read_text() == "systemd\n":
                    return int(pid)
        for path in self._cgroup.glob("init.scope/cgroup.procs"):
            return int(path.read_text().split()[0])
        return None


def until(what: Callable[[], _T], words: str, patience_s: float = PATIENCE_S) -> _T:
    """Ask until the answer is a true one."""
    deadline = time.monotonic() + patience_s
    while not (answer := what()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience_s:.0f} s in vain for {words}")
        time.sleep(0.1)
    return answer


def scenario(machine: Machine, hangs: int) -> Iterator[str]:
    """Observations during the life of a cell's computer. Raises AssertionError for unexpected behaviour."""
    yield f"booted: {machine.run('systemctl', '--version').stdout.splitlines()[0]} is the first process"
    yield from _started(machine)
    yield from _used_by_the_group(machine)
    for number in range(1, hangs + 1):
        yield _restarted(machine, number, "SIGSTOP", "watchdog")
    yield _restarted(machine, hangs + 1, "SIGKILL", "signal")
    yield from _told(machine, hangs)
    yield _installed_again(machine)
    yield from _not_served(machine)
    yield _why_no_dynamic_user(machine)
    yield from _removed(machine)


def _started(machine: Machine) -> Iterator[str]:
    emulate = ["--unit=cell", "--uid=rig", "--property=RuntimeDirectory=cell", "/opt/rig/bin/rig", "emulate", CELL]
    machine.run("systemd-run", *emulate, "--output=/run/cell", check=True)
    until(lambda: not machine.run("test", "-s", "/run/cell/truth.json").returncode, "the emulated cell")
    machine.run("install", "-D", "-m", "644", "/run/cell/rig.yaml", "/etc/rig/cell.yaml", check=True)
    machine.run(SOURCE_INSIDE / "scripts" / "install", "--addresses", check=True)
    machine.run("systemctl", "start", "rigd@cell", check=True)
    assert machine.shows("rigd@cell", "ActiveState") == "active"
    yield f"systemctl start rigd@cell came back when it was ready: {machine.shows('rigd@cell', 'StatusText')[:60]}…"
    owner = machine.run("stat", "-c", "%U", f"/proc/{machine.shows('rigd@cell', 'MainPID')}").stdout.strip()
    assert owner == "rig", owner
    yield "rigd runs as the user rig"


def _used_by_the_group(machine: Machine) -> Iterator[str]:
    """anna is in the group rig, and nobody is not."""

    def reading() -> bool:
        state = machine.run("rig", "status", "--json", user="anna")
        return not state.returncode and all(s["rate_hz"] > 1 for s in json.loads(state.stdout)["streams"].values())

    until(reading, "every stream to be read")
    start = ["rig", "record", "start", "lap", "--test", "yaw", "--direction", "cw"]
    run = machine.run(*start, user="anna", check=True).stdout.strip()
    time.sleep(2)
    machine.run("rig", "record", "stop", user="anna", check=True)
    machine.run("rig", "verify", run, user="anna", check=True)
    yield f"a member of the group rig recorded {run} and read it"
    assert machine.run("rig", "verify", run, user="nobody").returncode, "nobody can read a run"
    assert machine.run("rig", "status", user="nobody").returncode, "nobody can use the socket"
    yield "somebody else can neither use the socket nor read the run"


def _restarted(machine: Machine, number: int, sign: str, result: str) -> str:
    pid, began = machine.shows("rigd@cell", "MainPID"), time.monotonic()
    machine.run("kill", f"-{sign}", pid, check=True)
    until(lambda: machine.shows("rigd@cell", "NRestarts") == str(number), f"restart {number}")
    until(lambda: machine.shows("rigd@cell", "ActiveState") == "active", "rigd@cell to serve again")
    said = machine.run("journalctl", "--unit=rigd@cell", "--output=cat").stdout
    assert said.count(f"Failed with result '{result}'") >= 1, said
    assert machine.shows("rigd@cell", "MainPID") != pid
    return f"restart {number}: {sign} to {pid}, result {result}; served again after {time.monotonic() - began:.1f} s"


def _told(machine: Machine, hangs: int) -> Iterator[str]:
    said = machine.run("rig", "logs", "cell", check=True).stdout
    assert said.count("Watchdog timeout") == hangs and "serving" in said and "error" in said, said
    yield f"rig logs cell shows it in {len(said.splitlines())} lines, {hangs} watchdog time-outs among them"
    findings = machine.run("rig", "doctor", "/etc/rig/cell.yaml")
    assert "rigd@cell" in findings.stdout and not findings.returncode, findings.stdout + findings.stderr
    yield f"rig doctor finds nothing wrong in {len(findings.stdout.splitlines())} lines"


def _installed_again(machine: Machine) -> str:
    pid = machine.shows("rigd@cell", "MainPID")
    said = machine.run(SOURCE_INSIDE / "scripts" / "install", check=True).stdout.splitlines()
    unchanged = [line for line in said if line.startswith("unchanged")]
    assert len(unchanged) == 6 and "systemctl restart rigd@cell.service" in said[-1], said
    assert machine.shows("rigd@cell", "MainPID") == pid and not machine.run("rig", "status").returncode
    return "scripts/install again: the same lock and files are left as they are, the daemon goes on and is named"


def _not_served(machine: Machine) -> Iterator[str]:
    machine.run("systemctl", "stop", "cell", check=True)
    machine.run("systemctl", "restart", "rigd@cell")
    until(lambda: int(machine.shows("rigd@cell", "NRestarts")) >= 6, "six starts in vain")
    assert machine.shows("rigd@cell", "SubState") in ("auto-restart", "start"), machine.shows("rigd@cell", "SubState")
    yield "a cell that is switched off: still tried after 6 starts in vain"
    machine.run("bash", "-c", "echo 'name: [' >/etc/rig/wrong.yaml", check=True)
    assert machine.run("systemctl", "start", "rigd@wrong").returncode
    until(lambda: machine.shows("rigd@wrong", "ActiveState") == "failed", "the unit to fail")
    assert machine.shows("rigd@wrong", "NRestarts") == "0"
    yield "a rig file with a mistake: failed at once, and not tried again"


def _why_no_dynamic_user(machine: Machine) -> str:
    dynamic = ["--property=DynamicUser=yes", "--property=Group=rig", "--property=StateDirectory=probe"]
    made = ["--property=StateDirectoryMode=0750", "touch", "/var/lib/probe/run"]
    machine.run("systemd-run", "--wait", *dynamic, *made, check=True)
    seen = machine.run("ls", "/var/lib/probe/", user="anna")
    assert seen.returncode and "Permission denied" in seen.stderr, seen
    mode = machine.run("stat", "-c", "%a %U", "/var/lib/private").stdout.strip()
    return f"a DynamicUser's state could not be read by the group: /var/lib/private is {mode}"


def _removed(machine: Machine) -> Iterator[str]:
    again = machine.run(SOURCE_INSIDE / "scripts" / "install", "--remove", check=True).stdout
    for gone in ("/opt/rig", "/usr/local/bin/rig", "/etc/udev/rules.d/99-rig.rules"):
        assert machine.run("test", "-e", gone).returncode, gone
    assert machine.shows("rigd@cell", "LoadState") == "not-found"
    yield f"scripts/install --remove took everything away in {len(again.splitlines())} lines"
    machine.run("bash", "-c", "ls /etc/rig/cell.yaml /var/lib/rigd-cell/runs/*_lap/manifest.json", check=True)
    yield "rig file and run are still there"


def main(hangs: int = 3) -> int:
    """Boot, go through it, count."""
    seen = 0
    try:
        with tempfile.TemporaryDirectory(prefix="rig-booted-") as folder, booted(Path(folder)) as machine:
            for line in scenario(machine, hangs):
                seen += 1
                print(f"{seen:2d}  {line}", flush=True)
    except (Missing, AssertionError, subprocess.TimeoutExpired) as error:
        print(f"error: after {seen} things seen: {error}", file=sys.stderr)
        return 1
    print(f"{seen} of {seen} seen; killed by the watchdog and restarted {hangs} of {hangs} times")
    return 0


@contextlib.contextmanager
def booted(folder: Path) -> Iterator[Machine]:
    """A machine until the end of the block. Raises Missing."""
    mounts = [line.split() for line in Path("/proc/mounts").read_text().splitlines()]
    cgroup = next((Path(where) for _, where, kind, *_ in mounts if kind == "cgroup2"), None)
    if os.geteuid():
        raise Missing("only root may make the namespaces; run it with sudo")
    if cgroup is None or not Path("/lib/systemd/systemd").exists() or not shutil.which("nsenter"):
        raise Missing("needs a mounted cgroup2, systemd and nsenter; run: apt install systemd util-linux")
    own = cgroup / folder.name
    own.mkdir()
    machine = Machine(folder, own)
    try:
        yield machine
    finally:
        machine.stop()


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    parser = argparse.ArgumentParser(prog="scripts/dev booted", description=__doc__)
    parser.add_argument("hangs", type=int, nargs="?", default=3, help="how often the daemon is made to hang (3)")
    sys.exit(main(parser.parse_args().hangs))
