"""scripts/install into a directory, and out of it again; the same on a booted system is scripts/booted."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
INSTALL = ROOT / "scripts" / "install"
SYSTEMD = ROOT / "systemd"


@pytest.mark.skipif(os.geteuid() != 0, reason="not root")
@pytest.mark.parametrize(
    ("mode", "owner", "refused"), [(0o666, 0, True), (0o644, 65534, True), (0o644, 0, False), (0o664, 0, False)]
)
def test_a_checkout_that_others_can_write_is_not_run_by_root(tmp_path, mode, owner, refused):
    """Its Python is none, so that it ends there where it is not refused before."""
    (tmp_path / "scripts").mkdir(mode=0o755)
    install = Path(shutil.copy(INSTALL, tmp_path / "scripts" / "install"))
    written = tmp_path / "scripts" / "anything.py"
    written.touch()
    os.chown(written, owner, -1)
    written.chmod(mode)
    alone = {name: value for name, value in os.environ.items() if not name.startswith("SUDO_")}
    command = ["bash", install]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, env=alone | {"PYTHON": "/nonexistent/python3"}
    )
    assert done.returncode == 1 and ("anything.py" in done.stderr) == refused, done.stderr
    assert ("is no Python" in done.stderr) != refused


def test_the_addresses_of_each_rig_file_are_allowed(tmp_path):
    """With a Python that stands for the installed one: which rig needs what is test_addresses."""
    python = tmp_path / "opt/rig/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\ncase $4 in *wrong*) echo "error: wrong" >&2; exit 3;; esac\necho "[Service] $*"\n')
    python.chmod(0o755)
    (tmp_path / "etc/rig").mkdir(parents=True)
    for name in ("cell", "wrong"):
        (tmp_path / f"etc/rig/{name}.yaml").touch()

    def install(*options: str) -> list[str]:
        command = [INSTALL, "--root", tmp_path, *options]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()

    units = tmp_path / "etc/systemd/system"
    drop_in = units / "rigd@cell.service.d/addresses.conf"
    said = install("--addresses")
    assert said == [
        f"installed    {drop_in}",
        f"skipped      {units}/rigd@wrong.service.d/addresses.conf: error: wrong",
    ]
    assert drop_in.read_text() == f"[Service] -I -m daq.service.addresses {tmp_path}/etc/rig/cell.yaml\n"
    assert install("--addresses")[0] == f"unchanged    {drop_in}"
    install("--remove")
    assert not list(units.iterdir()) and len(list((tmp_path / "etc/rig").iterdir())) == 2


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        ([], 1, "error: scripts/install: only root"),
        (["--remove"], 1, "error: scripts/install: only root"),
        (["--purge"], 2, "unknown argument '--purge'; use: scripts/install [--addresses | --remove] [--root DIR]"),
        (["--root"], 2, "--root needs a directory"),
    ],
)
def test_without_root_it_is_one_line(options, code, says):
    nobody = [] if os.getuid() else ["unshare", "--user"]
    if nobody and (not shutil.which("unshare") or subprocess.run([*nobody, "true"], check=False).returncode):
        pytest.skip("always root")
    done = subprocess.run([*nobody, INSTALL, *options], capture_output=True, text=True, check=False)
    assert done.returncode == code and not done.stdout
    assert done.stderr.count("\n") == 1 and says in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--root"], "--root needs a directory"),
        (["--root", "/nonexistent"], "'/nonexistent'"),
        (["--rot"], "unknown argument '--rot'"),
        (["--root", "/", "more"], "unknown argument 'more'"),
    ],
)
def test_wrong_argument_of_rig_addresses_is_one_line(options, says):
    done = subprocess.run([SYSTEMD / "rig-addresses", *options], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("error: rig-addresses: ") and done.stderr.count("\n") == 1, done.stderr
    assert says in done.stderr and done.stderr.endswith("; use: rig-addresses [--root DIR]\n")


def test_removed_package_leaves_only_drop_ins_of_others(tmp_path):
    units = tmp_path / "systemd/system"
    for name, files in {
        "one": ["addresses.conf"],
        "two": ["addresses.conf", "own.conf"],
        "three": ["own.conf"],
    }.items():
        (units / f"rigd@{name}.service.d").mkdir(parents=True)
        for file in files:
            (units / f"rigd@{name}.service.d" / file).touch()
    script = (SYSTEMD / "debian/postrm").read_text().replace("/etc/systemd", f"{tmp_path}/systemd")
    script = script.replace("/run/systemd/system", "/nonexistent")
    subprocess.run(["sh", "-c", script, "postrm", "remove"], check=True)
    left = sorted(path.relative_to(units).as_posix() for path in units.rglob("*.conf"))
    assert left == ["rigd@three.service.d/own.conf", "rigd@two.service.d/own.conf"] and len(list(units.iterdir())) == 2


def _pins(lock: str) -> dict[str, str]:
    return dict(re.findall(r"^([a-z0-9-]+)==(\S+)", (ROOT / "scripts" / lock).read_text(), re.M))


def test_cell_gets_the_tested_versions():
    runtime, developing = _pins("runtime.lock"), _pins("requirements.lock")
    assert runtime.items() < developing.items()
    needed = re.search(r"^dependencies = \[(.*?)^\]", (ROOT / "pyproject.toml").read_text(), re.M | re.S)
    assert needed
    names = re.findall(r'"([a-z0-9]+)', needed[1])
    assert len(names) > 10 and {*names, "hatchling"} <= runtime.keys()
    assert not {"pytest", "ruff", "mypy"} & runtime.keys()


RULE = re.compile(
    r"""(ACTION|SUBSYSTEMS?|DRIVERS?|KERNELS?|ATTRS?\{\w+\}|ENV\{\w+\}|SYMLINK|GROUP|MODE)(==|!=|\+=|=)"[^"]*"$"""
)


def test_the_udev_rules_are_rules():
    """By the grammar of udev(7): matches first, then at least one assignment; `udevadm verify` where there is one."""
    path = ROOT / "systemd" / "99-rig.rules"
    rules = [line for line in path.read_text().splitlines() if line and line[0] != "#"]
    assert len(rules) == 5
    (named,) = [number for number, rule in enumerate(rules) if "SYMLINK" in rule]
    assert 'ATTRS{port_number}=="[1-9]*", ENV{RIG_PORT}="-$attr{port_number}"' in rules[named - 1]
    assert rules[named].endswith('NUM}$env{RIG_PORT}"')  # no two ports of an adapter have one name
    for rule in rules:
        found = [RULE.match(token.strip()) for token in re.split(r",\s*", rule)]
        assert all(found), rule
        operators = [match[2] for match in found if match]
        assert operators[0] in ("==", "!=") and operators[-1] in ("=", "+="), rule
        assert sorted(operators, key=lambda sign: sign in ("=", "+=")) == operators, rule
    if (
        shutil.which("udevadm")
        and "verify" in subprocess.run(["udevadm", "--help"], capture_output=True, text=True, check=False).stdout
    ):
        done = subprocess.run(["udevadm", "verify", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
