"""Write the software bill of materials of a release, in CycloneDX JSON.

It lists what scripts/install and the Debian package install, as pinned in scripts/runtime.lock: each package with
version, licence, hash and dependencies. The exit code is 75 if the package registry is unreachable.
"""

from __future__ import annotations

import json
import re
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from scripts.tools.wheel import OFFLINE, ROOT, VERSION, Environment, install_into, new_environment

LOCK = ROOT / "scripts" / "runtime.lock"
GENERATOR = "cyclonedx-bom==7.5.0"
"""Program that reads an environment, in an environment of its own: rig does not need it."""
_PINNED = re.compile(r"^([\w.-]+)==([^\s\\]+)")
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")


def main(
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory for the file.")] = Path("dist"),
) -> None:
    """Install the pinned packages into an empty environment, and describe them."""
    with tempfile.TemporaryDirectory(prefix="rig-sbom-") as scratch:
        tool, described = (new_environment(Path(scratch) / name) for name in ("tool", "described"))
        for environment, packages in (
            (tool, [GENERATOR]),
            (described, ["--no-deps", "--require-hashes", "--requirement", str(LOCK)]),
        ):
            if install_into(environment, *packages):
                print(f"error: {' '.join(packages)}: cannot be installed; run it again with network")
                raise typer.Exit(OFFLINE)
        document = with_hashes(_describe(tool, described), LOCK.read_text(encoding="utf-8"))
    if missing := sorted(pinned(LOCK.read_text(encoding="utf-8")).keys() - names(document)):
        print(f"error: {', '.join(missing)}: pinned, but not described; repair scripts/runtime.lock with scripts/lock")
        raise typer.Exit(1)
    output.mkdir(parents=True, exist_ok=True)
    file = output / f"rig_metrology-{VERSION}.cdx.json"
    file.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"wrote {file}: {len(document['components'])} packages")


def _describe(tool: Environment, described: Environment) -> dict[str, Any]:
    arguments = ("--pyproject", str(ROOT / "pyproject.toml"), "--mc-type", "application", "--of", "JSON")
    python = described.place / "bin" / "python"
    document: dict[str, Any] = json.loads(tool.run("cyclonedx-py", "environment", str(python), *arguments))
    return document


def normal(name: str) -> str:
    """Name of a package as PEP 503 compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned(lock: str) -> dict[str, tuple[str, list[str]]]:
    """Version and SHA-256 hashes of each package in the text of a lock file."""
    packages: dict[str, tuple[str, list[str]]] = {}
    name = ""
    for line in lock.splitlines():
        if match := _PINNED.match(line):
            name = normal(match[1])
            packages[name] = (match[2], [])
        if name:
            packages[name][1].extend(_HASH.findall(line))
    return packages


def names(document: dict[str, Any]) -> set[str]:
    return {normal(component["name"]) for component in document["components"]}


def with_hashes(document: dict[str, Any], lock: str) -> dict[str, Any]:
    """The document with the hashes of the distributions that may be installed, and without paths of this computer."""
    packages = pinned(lock)
    components = []
    for component in document["components"]:
        _, hashes = packages.get(normal(component["name"]), ("", []))
        files = [reference for reference in component.get("externalReferences", []) if "file:" not in reference["url"]]
        if hashes:
            sums = [{"alg": "SHA-256", "content": one} for one in hashes]
            url = f"https://pypi.org/simple/{normal(component['name'])}/"
            files.append({"type": "distribution", "url": url, "hashes": sums})
        components.append({**component, "externalReferences": files} if files else component)
    return {**document, "components": components}


if __name__ == "__main__":
    typer.run(main)
