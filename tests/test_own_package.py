"""The pages of docs/how-to, *in a package of your own*: installed beside rig and used, without a change of rig."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support.how_to import HOW_TO, ROOT, blocks, offers, run

pytestmark = pytest.mark.cpu_limit(60)
PAGES = {
    "cell_dial": "add-a-gauge.md",
    "cell_arm": "add-a-robot-interface.md",
    "cell_bow": "add-an-effect.md",
    "cell_acme": "add-a-maker.md",
    "cell_height": "add-a-test-kind.md",
}
EXAMPLES = {
    "cell_dial": "gauge", "cell_arm": "robot", "cell_bow": "effect", "cell_acme": "maker", "cell_height": "test_kind"
}  # fmt: skip


def installed(site: Path, package: str) -> None:
    (toml,) = blocks(PAGES[package], "toml")
    project = tomllib.loads(toml)["project"]
    (files,) = (block for block in blocks(PAGES[package], "text") if package in block)
    (site / package).mkdir()
    for line in files.splitlines():
        name, source = line.replace(",", " ").split()[:2]
        text = (HOW_TO / "examples" / EXAMPLES[package] / source).read_text()
        text = re.sub(r"rigs\.schema\.example_\w+", f"{package}.schema", text)
        if name.endswith("schema.py"):
            driver = f'    driver: ClassVar[str] = "{package}.protocol"\n    origin: '
            text = text.replace("    origin: ", driver, 1)
        (site / name).write_text(text)
    offers(site, project["name"], project["entry-points"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    tree = tmp_path_factory.mktemp("site")
    for name in ("rigs", "daq", "analysis"):
        (tree / name).symlink_to(ROOT / name)
    for package in PAGES:
        installed(tree, package)
    offers(tree, "half-done", {"rig.gauges": {"half_done": "nowhere.at_all:Gauge", "tesa_tt": "cell_dial.schema:X"}})
    offers(tree, "half-made", {"rig.makers": {"half_made": "nowhere.at_all", "kuka": "cell_acme", "bare": "cell_bow"}})
    return tree


USED = """
import sys
from daq.gauges import device, host
from daq.feedback import host as robot_host
from rigs.effects import VOCABULARY
from rigs.interfaces import list_interfaces, models
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
gauges = {one.model_fields["interface"].annotation.__args__[0]: one for one in models(Gauge)}
robots = {one.model_fields["interface"].annotation.__args__[0]: one for one in models(Feedback)}
dial = gauges["example_dial"](interface="example_dial", port="/dev/null", offset_mm=25)
ours, theirs = host([dial]), device([dial], lambda now_ns: [1.25])
print(type(ours).__name__, theirs.received(b"D\\r", 0).send)
print(type(robot_host(robots["example_arm"](interface="example_arm", port="udp://0.0.0.0:7000"))).__name__)
print(VOCABULARY["gauge_bow"].__module__, "example_dial" in {one.name for one in list_interfaces()})
print(gauges["tesa_tt"].__module__)
"""


def test_gauge_robot_and_effect_of_other_packages_are_used(site):
    done = run(site, sys.executable, "-c", USED)
    assert done.returncode == 0, done.stderr
    answer, robot, effect, tesa = done.stdout.splitlines()
    assert answer == "Polled b'D=+001.2500 mm\\r\\n'"
    assert robot == "Streamed"
    assert effect == "cell_bow.effect True"
    assert tesa == "rigs.schema.gauges"


def test_a_test_kind_of_another_package_is_imported_and_evaluated(site):
    table = HOW_TO / "examples" / "test_kind" / "heights.csv"
    rig = (sys.executable, "-c", "from analysis.cli import main; main()")
    done = run(site, *rig, "import", str(table), "--rig", "ur10e-cell", "--test", "height", "-o", "heights/monday")
    assert done.returncode == 0, done.stderr
    done = run(site, *rig, "analyse", "heights/monday", "--json")
    assert '"height_band_mm": {' in done.stdout, done.stdout + done.stderr
    offers(site, "half-kind", {"rig.tests": {"half_kind": "nowhere:Kind", "touch": "cell_height:Height"}})
    done = run(site, *rig, "import", str(table), "--rig", "ur10e-cell", "--test", "half_kind", "-o", "heights/tuesday")
    assert done.returncode == 3 and "nowhere:Kind" in done.stderr
    done = run(site, sys.executable, "-c", "import analysis.runs.tables as t; print(t.format_of('touch'))")
    assert "analysis.procedures.touch" in done.stdout


OF_A_MAKER = """
import sys
from analysis.cli import main
from analysis.apps.makers import maker_by, maker_of_file
from rigs.errors import UseError
from rigs.makers import MAKERS, maker_named
others = [name for name in MAKERS if "analysis" not in maker_by(name).package]
print(others, maker_named("ACME 6"), maker_named("Half Made"))
print(maker_by("kuka").package, maker_of_file("a.ACM").name)
for name in "half_made", "bare":
    try:
        maker_by(name).writer
    except UseError as error:
        print(error)
sys.argv[1:] = "program", "ur10e-cell", "--for", "Acme", "--test", "yaw", "-o", sys.argv[1]
main()
"""


def test_a_maker_of_another_package_has_programs_written(site, tmp_path):
    done = run(site, sys.executable, "-c", OF_A_MAKER, str(tmp_path / "made"))
    assert done.returncode == 0, done.stderr
    names, places, broken, bare, *_ = done.stdout.splitlines()
    assert names == "['acme', 'bare', 'half_made'] acme half_made" and places == "analysis.apps.makers.kuka acme"
    assert broken.startswith("half_made: nowhere.at_all.writer ")
    assert bare.startswith("bare: ") and "cell_bow.writer.WRITER" in bare
    assert (tmp_path / "made" / "yaw_acw_ur10e.acm").read_bytes().count(b"\r\nARC ") == 15


def check(site: Path, file: Path) -> subprocess.CompletedProcess[str]:
    return run(site, sys.executable, "-c", "from analysis.cli import main; main()", "check", str(file))


def test_a_rig_file_names_them(site):
    text = (ROOT / "rigs" / "paper-fanuc.yaml").read_text()
    text = text.replace("sylvac_opto_rs", "example_dial").replace("4800 7E2", "9600 8N1")
    text = re.sub(r".*mode: continuous\n", "", text)
    bow = "\neffects:\n  - {effect: gauge_bow, gauge: g1, relative_per_mm: 0.001}\n"
    file = site / "cell.yaml"
    file.write_text(text + bow)
    done = check(site, file)
    assert done.returncode == 0, done.stdout + done.stderr
    file.write_text((text + bow).replace("example_dial", "half_done"))
    done = check(site, file)
    assert done.returncode == 3
    assert "half-done" in done.stdout + done.stderr
