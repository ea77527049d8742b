"""Folders of a package that import each other in a circle.

The packages are those of the working directory: daq, rigs and analysis unless others are given. A module belongs to
the folder that it lies in, a package's `__init__` to that package. Each group of folders of which every one reaches
every other is one cycle; an import for types alone closes none. The exit code is 1 if there is any.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import grimp
import numpy as np
from scipy.sparse.csgraph import connected_components

PACKAGES = ("daq", "rigs", "analysis")


def folder_of(module: str) -> str:
    """The package that a module lies in; a package lies in itself."""
    is_package = Path(*module.split(".")).is_dir()
    return module if is_package else module.rpartition(".")[0]


def folder_cycles(package: str) -> list[list[str]]:
    """Groups of at least two folders of the package that import each other in a circle, sorted by name."""
    graph = grimp.build_graph(package, cache_dir=None, exclude_type_checking_imports=True)
    folders = sorted({folder_of(module) for module in graph.modules})
    place = {folder: number for number, folder in enumerate(folders)}
    imports = np.zeros((len(folders), len(folders)), dtype=bool)
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            imports[place[folder_of(module)], place[folder_of(imported)]] = True
    _, groups = connected_components(imports, directed=True, connection="strong")
    cycles = [[folder for folder, of in zip(folders, groups, strict=True) if of == group] for group in set(groups)]
    return sorted(cycle for cycle in cycles if len(cycle) > 1)


def main(packages: Sequence[str]) -> int:
    """Print the number of cycles of each package, and the folders of each cycle."""
    found = {package: folder_cycles(package) for package in packages}
    for package, cycles in found.items():
        print(f"{package}: {len(cycles)} import cycles between folders")
        for cycle in cycles:
            print(f"  {len(cycle)} folders: {', '.join(cycle)}")
    return int(any(found.values()))


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    parser = argparse.ArgumentParser(prog="scripts/dev folder_cycles", description=__doc__)
    parser.add_argument("packages", nargs="*", default=PACKAGES, help="packages of the working directory")
    sys.exit(main(parser.parse_args().packages))
