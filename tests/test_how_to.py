"""The pages of docs/how-to that add a driver, followed to the letter in a copy of the tree."""

import re
import shutil
import sys
from dataclasses import dataclass

import pyarrow.parquet as pq
import pytest

from tests.support.how_to import HOW_TO, blocks, checked, commands, followed, output, run


@dataclass(frozen=True)
class Page:
    name: str
    interface: str
    stream: str


pytestmark = pytest.mark.cpu_limit(300)  # checks of a whole tree, in processes of their own
PAGES = [
    Page("add-a-gauge.md", "example_dial", "g1"),
    Page("add-a-robot-interface.md", "example_arm", "robot"),
]


@pytest.fixture(scope="module", params=PAGES, ids=lambda page: page.interface)
def grown(request, tmp_path_factory):
    page: Page = request.param
    tree = tmp_path_factory.mktemp(page.interface)
    return page, tree, followed(page.name, tree)


@pytest.mark.timeout(300)
def test_the_new_driver_passes_the_checks_of_style_and_types(grown):
    page, tree, files = grown
    assert len([name for name in files if name.endswith(f"{page.interface}.py")]) >= 2
    checked(tree, files)


def test_the_new_driver_keeps_the_contract_of_every_driver(grown):
    page, tree, _ = grown
    chosen = f"{page.interface.split('_')[1]} or every_driver"
    said = output(
        tree, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, "tests/daq/protocol"
    )
    assert int(re.findall(r"(\d+) passed", said)[0]) >= 9  # contract and conversation of the driver


def test_generated_pages_contain_the_new_driver(grown):
    page, tree, _ = grown
    (block,) = (block for block in blocks(page.name, "sh") if "scripts/dev" in block)
    made = re.findall(r"^scripts/dev (\w+) > (\S+)", block, re.M)
    assert len(made) == 2
    for program, path in made:
        assert path.removeprefix("docs/") in output(tree, sys.executable, f"scripts/tools/{program}.py")
        assert page.interface in output(tree, sys.executable, f"scripts/tools/{program}.py")


def test_the_commands_of_the_page_record_with_the_new_driver(grown):
    page, tree, _ = grown
    # What waits in vain is ended, and the emulated cell and the daemon with it.
    script = f"trap 'kill $(jobs -p) 2> /dev/null' EXIT\n{commands(page.name, 'rigd')}\nwait"
    done = run(tree, "timeout", "120", "bash", "-c", script, timeout_s=150)
    assert ": whole\n" in done.stdout, done.stdout + done.stderr
    assert page.interface in done.stdout
    (first,) = tree.glob("*/runs/*_first")
    samples = sum(pq.read_metadata(chunk).num_rows for chunk in first.glob(f"{page.stream}-*.parquet"))
    assert samples > 0  # a slow computer takes fewer
    faults = [row for chunk in first.glob("faults-*.parquet") for row in pq.read_table(chunk).to_pylist()]
    assert [fault for fault in faults if fault["stream"] in (page.stream, "g2") and fault["kind"] == "garbled"] == []


@pytest.mark.timeout(300)
@pytest.mark.parametrize("grown", [PAGES[1]], indirect=True, ids=["example_stream"])
def test_the_stream_of_the_page_passes_the_checks_and_its_tests(grown):
    _, tree, _ = grown
    example = HOW_TO / "examples" / "stream"
    files = [str(path.relative_to(example)) for path in sorted(example.rglob("*.py"))]
    shutil.copytree(example, tree, dirs_exist_ok=True)
    checked(tree, files)
    said = output(tree, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files[-1:])
    assert "4 passed" in said
