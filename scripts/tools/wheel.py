"""Build the wheel, install it into an empty environment, and use it there.

The environment cannot access the working tree, so missing parts are detected: commands, rig files, templates, type
markers, dependencies. Required packages come from the package registry; the exit code is 75 if it is unreachable. With
--borrow they come from the current environment, and only dependencies missing in pyproject.toml remain undetected.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rigs.distribution import NAME

ROOT = Path(__file__).parents[2]
VERSION: str = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
OFFLINE = 75
"""EX_TEMPFAIL of sysexits.h: try again later."""
TYPED = """
from importlib.resources import files
assert all((files(package) / "py.typed").is_file() for package in ("rigs", "daq", "analysis"))
"""
PARTS = """
import distributed, rosbags.typesys, s3fs, sshfs
import analysis.apps.window.serve, daq.opc_ua.robotics
"""
"""Program that uses the extras without a network: cluster, remote, ros, web, opcua."""


@dataclass(frozen=True)
class Environment:
    """An environment with the installed wheel, and an empty working directory."""

    place: Path
    work: Path

    def run(self, program: str, *arguments: str) -> str:
        """Run a program of the environment in the empty directory and return its output."""
        outside = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        command = [self.place / "bin" / program, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=self.work, env=outside)
        if done.returncode:
            _fail(f"{program} {' '.join(arguments)} ended with {done.returncode}: {done.stdout}{done.stderr}")
        return done.stdout


def main(
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Keep the wheel and the source here.")] = None,
    borrow: Annotated[bool, typer.Option("--borrow", help="Take the packages that rig needs from here.")] = False,
    extras: Annotated[bool, typer.Option("--extras", help="Install the source with every extra, too.")] = False,
) -> None:
    """Build, install and use the wheel; each step prints a line."""
    with tempfile.TemporaryDirectory(prefix="rig-wheel-") as scratch:
        wheel = build(output or Path(scratch) / "dist")
        print(f"built {wheel.name}, {wheel.stat().st_size / 1e3:.0f} kB", flush=True)
        environment = install(str(wheel), Path(scratch) / "core", borrow=borrow)
        print("installed it into an empty environment", flush=True)
        for line in use(environment):
            print(line, flush=True)
        if extras:
            source = wheel.with_name(f"rig_metrology-{VERSION}.tar.gz").resolve()
            whole = install(f"{NAME}[all] @ {source.as_uri()}", Path(scratch) / "whole")
            print(f"installed {source.name} with every extra into another", flush=True)
            print(use_extras(whole), flush=True)


def build(folder: Path) -> Path:
    """Build source and wheel into a directory, and return the wheel."""
    command = [sys.executable, "-m", "hatchling", "build", "--directory", folder.resolve()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode:
        _fail(f"the wheel cannot be built: {done.stderr}")
    return folder / f"rig_metrology-{VERSION}-py3-none-any.whl"


def new_environment(scratch: Path) -> Environment:
    environment = Environment(scratch / "environment", scratch / "empty")
    environment.work.mkdir(parents=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment.place], check=True)
    return environment


def install(package: str, scratch: Path, *, borrow: bool = False) -> Environment:
    """Create an empty environment and install a package with its dependencies, or with the locally installed ones."""
    environment = new_environment(scratch)
    if borrow:
        packages = environment.place / "lib" / Path(sysconfig.get_path("purelib")).parent.name / "site-packages"
        # Only a path: .pth files of the local environment, which refer to the working tree, have no effect.
        (packages / "borrowed.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    if install_into(environment, package, *(("--no-deps",) if borrow else ())):
        if install_into(environment, "--dry-run", "--ignore-installed", "--no-deps", "pyserial"):
            print("error: the package registry cannot be reached; run it again with network", file=sys.stderr)
            raise typer.Exit(OFFLINE)
        _fail(f"pip cannot install {package}; its message stands above")
    return environment


def use(environment: Environment) -> list[str]:
    """Use the installed programs like a new user, and return a line for each check."""
    version = environment.run("rig", "--version").strip()
    if version != f"rig {VERSION}":
        _fail(f"it calls itself {version}, and pyproject.toml {VERSION}")
    environment.run("rigd", "--help")
    environment.run("python", "-c", TYPED)
    rigs = environment.run("rig", "example", "rigs").split()
    for rig in rigs:
        if not rig.endswith(".effects.yaml"):
            environment.run("rig", "check", rig)
    runs = environment.run("rig", "simulate", "rigs/paper-fanuc.yaml", "--test", "yaw", "-o", "runs").split()
    environment.run("rig", "analyse", *runs, "--plot", "pictures")
    pictures = list((environment.work / "pictures").iterdir())
    environment.run("rig", "report", *runs, "--no-diagnosis", "-o", "report.html")
    return [
        f"{version}; rigd starts; the three packages are marked as typed",
        f"rig example wrote {len(rigs)} files, and each rig is good",
        f"rig simulate, rig analyse and rig report: {len(runs)} runs, {len(pictures)} pictures, a page",
    ]


def use_extras(environment: Environment) -> str:
    """Run a command that needs each of the optional dependencies, in an environment with all of them, and return a
    report line.
    """
    environment.run("rig", "example", "rigs")
    (run, *_) = environment.run("rig", "simulate", "rigs/ur10e-cell.yaml", "--test", "yaw", "-o", "runs").split()
    environment.run("rig", "export-urdf", "rigs/ur10e-cell.yaml", "-o", "arm.urdf")
    environment.run("rig", "import-urdf", "arm.urdf", "-o", "arm.yaml")
    environment.run("rig", "export", run, "--to", "xlsx", "-o", "run.xlsx")
    environment.run("rig", "report", run, "--no-diagnosis", "-o", "report.pdf")
    environment.run("python", "-c", PARTS)
    return "URDF, workbook and PDF written; the parts for cluster, remote runs, window and OPC UA are there"


def install_into(environment: Environment, *arguments: str) -> int:
    """Run pip and return its exit code. The pip belongs to the base Python, because this environment has none."""
    python = os.environ.get("PYTHON") or getattr(sys, "_base_executable", sys.executable)
    into = ["--python", str(environment.place / "bin" / "python"), "--disable-pip-version-check"]
    quickly = ["--quiet", "--no-compile"]  # modules are then compiled on import: 19 s of CPU time instead of 35 s
    return subprocess.run([python, "-m", "pip", *into, "install", *quickly, *arguments], check=False).returncode


def _fail(why: str) -> None:
    print(f"error: {why}", file=sys.stderr)
    raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
