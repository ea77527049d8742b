"""The Debian package in a bare Debian: installed, a lap recorded, upgraded, removed, the runs still there. As root.

`scripts/deb` builds the package, debootstrap makes the Debian (both need the network), and everything happens in a
chroot without systemd: rigd and the emulated cell are started by hand. `scripts/dev packaged [DEB]`; needs root and
debootstrap.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
RECORDING = """
set -eu
export HOME=/tmp XDG_RUNTIME_DIR=/tmp/runtime
install -d -o rig -g rig -m 700 /var/lib/rigd-cell $XDG_RUNTIME_DIR
cd $XDG_RUNTIME_DIR
as_rig() { setpriv --reuid=rig --regid=rig --init-groups "$@"; }
as_rig rig emulate paper-fanuc --output cell </dev/null >/tmp/emulated.log 2>&1 & emulated=$!
for try in $(seq 100); do [ -s cell/truth.json ] && break; sleep 0.2; done
as_rig rigd cell/rig.yaml --runs /var/lib/rigd-cell/runs >/tmp/rigd.log 2>&1 & daemon=$!
for try in $(seq 100); do as_rig rig status >/dev/null 2>&1 && break; sleep 0.2; done
as_rig rig record start lap --test yaw --direction cw
sleep 5
as_rig rig record stop
kill $daemon; wait $daemon || true
kill $emulated; wait $emulated || true
"""
"""Record a lap of an emulated cell by hand, as the user of the service."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("deb", type=Path, nargs="?", help="a package that is there already (default: build it)")
    given = parser.parse_args()
    missing = [name for name in ("debootstrap", "dpkg-deb") if not shutil.which(name)]
    if os.geteuid() or missing:
        print(f"skipped: needs root{''.join(f' and {name}' for name in missing)}", file=sys.stderr)
        return 0
    with tempfile.TemporaryDirectory() as scratch, bare_debian(Path(scratch) / "debian") as debian:
        deb = given.deb or Path(run(ROOT / "scripts/deb", scratch).splitlines()[-1])
        shutil.copy(deb, debian / "rig.deb")
        for line in life(debian):
            print(line, flush=True)
    return 0


def life(debian: Path) -> Iterator[str]:
    """Observations from installation to removal. Raises AssertionError for unexpected behaviour."""
    inside(debian, "apt-get install -qq --yes --no-install-recommends /rig.deb")
    yield f"installed: {inside(debian, 'rig --version').strip()}"
    assert inside(debian, "id -nG rig").split() == ["rig", "dialout"]
    assert inside(debian, "stat -c %a /etc/rig /usr/lib/systemd/system/rigd@.service").split() == ["755", "644"]
    inside(debian, RECORDING)
    runs = inside(debian, "ls /var/lib/rigd-cell/runs").split()
    assert len(runs) == 1, runs
    yield f"recorded: {runs[0]}, {inside(debian, f'rig verify /var/lib/rigd-cell/runs/{runs[0]}').splitlines()[0]}"
    inside(debian, "apt-get install -qq --yes --reinstall /rig.deb")
    yield f"upgraded: {inside(debian, f'rig verify /var/lib/rigd-cell/runs/{runs[0]}').splitlines()[0]}"
    inside(debian, "apt-get purge -qq --yes rig-metrology")
    left = inside(debian, "ls -d /opt/rig /usr/bin/rig /usr/lib/udev/rules.d/99-rig.rules 2>/dev/null || true")
    assert not left.strip(), left
    assert inside(debian, "ls /var/lib/rigd-cell/runs").split() == runs
    yield "removed: programs, unit and rules are gone, the run and its owner are still there"


@contextmanager
def bare_debian(folder: Path) -> Iterator[Path]:
    """A minimal Debian of the release of this computer, without services."""
    release = next(
        line.partition("=")[2] for line in Path("/etc/os-release").read_text().splitlines() if "CODENAME" in line
    )
    run("debootstrap", "--variant=minbase", release, folder)
    try:
        for name in ("proc", "dev", "dev/pts"):
            run("mount", "--bind", f"/{name}", folder / name)
        yield folder
    finally:
        for name in ("dev/pts", "dev", "proc"):
            subprocess.run(["umount", "-l", folder / name], check=False, capture_output=True)


def inside(debian: Path, script: str) -> str:
    """Output of a shell script in the chroot."""
    return run("chroot", debian, "/bin/bash", "-c", script)


def run(*command: str | Path) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise AssertionError(f"{' '.join(map(str, command))[:200]}: {done.returncode}: {done.stdout}{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
