"""Check the requirements of a release before tagging it, and list the manual steps.

The version is defined in pyproject.toml, and repeated in CITATION.cff. The exit code is 1 if a requirement is not met.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from rigs.distribution import NAME

CHECKS = {
    "every check and test passes": ["scripts/test"],
    "the demo agrees with the truth": ["scripts/demo"],
    "wheel and source work in empty environments": ["scripts/dev", "wheel", "--extras", "--output", "dist"],
    "the Debian package is built": ["scripts/deb", "dist"],
    "the bill of materials (CycloneDX) is written": ["scripts/dev", "sbom", "--output", "dist"],
}
"""Checks that take minutes: requirement and command."""


def main(
    quick: Annotated[
        bool, typer.Option("--quick", help="Leave out what takes minutes: tests, demo and wheel.")
    ] = False,
) -> None:
    """Check the repository of the working directory."""
    root = Path(_git(Path.cwd(), "rev-parse", "--show-toplevel"))
    version = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    print(f"release of {version}")
    lacking = 0
    for what, remedy in (*of_files(root, version), *([] if quick else of_commands(root))):
        print(f"  ready  {what}" if not remedy else f"  LACKS  {what}: {remedy}", flush=True)
        lacking += bool(remedy)
    if lacking:
        print(f"{lacking} things are lacking")
        raise typer.Exit(1)
    if quick:
        print(f"not checked: {'; '.join(CHECKS)}")
    print("then, by hand:")
    print(f"  git tag --annotate v{version} --message 'rig {version}' && git push origin v{version}")
    print(f"  publish dist/, which is called {NAME}, and the section of CHANGELOG.md as the text of the release")
    print("  begin the next section of CHANGELOG.md, ## [Unreleased]")


def of_files(root: Path, version: str) -> Iterator[tuple[str, str]]:
    """Yield each requirement that is visible in the files, with the action to take; empty if it is met."""
    changed = _git(root, "status", "--porcelain")
    yield "the checkout is clean", "commit or remove what git status shows" if changed else ""
    tagged = _git(root, "tag", "--list", f"v{version}")
    yield "the version is new", f"v{version} is tagged; raise version in pyproject.toml" if tagged else ""
    sections = _sections((root / "CHANGELOG.md").read_text(encoding="utf-8"))
    yield "CHANGELOG.md has a section of it", "" if sections.get(version) else f"write its lines under ## {version}"
    cited = re.search(r"^version: (.+)$", (root / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    remedy = f"set version and date-released to those of {version}"
    yield "CITATION.cff has the version", "" if cited and cited[1] == version else remedy
    yield "no line of CHANGELOG.md is left over", f"move them to ## {version}" if sections.get("Unreleased") else ""


def of_commands(root: Path) -> Iterator[tuple[str, str]]:
    """Yield each requirement that needs a command, with its exit code if it fails."""
    for what, command in CHECKS.items():
        code = subprocess.run(command, cwd=root, check=False).returncode
        yield what, f"{' '.join(command)} ended with {code}" if code else ""


def _sections(changelog: str) -> dict[str, str]:
    """Return the text of each section by its version, without brackets and date."""
    parts = re.split(r"^## +\[?([^\s\]]+)\]?.*$", changelog, flags=re.M)
    return {heading: text.strip() for heading, text in zip(parts[1::2], parts[2::2], strict=True)}


def _git(where: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=where, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"error: {where}: {done.stderr.strip()}; run it in a checkout of rig")
    return done.stdout.strip()


if __name__ == "__main__":
    typer.run(main)
