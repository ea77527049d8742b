"""The page docs/arms.md from the arm library and its second sources: `scripts/dev arms_page > docs/arms.md`.

Each arm is held against the numbers of others on 1000 random postures within its limits.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigs.arms import Arm

POSTURES = 1000
EXACT = 1e-6
"""mm and rad below which a difference is the rounding of what was typed, and differs from computer to computer."""
HEAD = """\
# The arm library

A rig file needs the constants of its arm. For these arms they are there, each from a source that it names:

```sh
rig arms                                                  # the table of all
rig arms kuka-kr-6-r900-2                                 # one as the robot section of a rig file
rig arms ur10e --calibration calibration.conf -o arm.yaml # a UR with its own calibration
```

What `rig arms NAME` shows is pasted into a rig file as its `robot:` section; `payload_kg` and `tool` are yours to add.
Everything in it is what a maker publishes of a kind of arm. Yours differs from it by some tenths of a millimetre up to
millimetres, which is what `rig diagnose` and `rig calibrate` are for.

Angles and coupling are those of the controller: KUKA counts A1, A4 and A6 the other way round, and FANUC's J3 is
measured from the horizontal, so that its axis 3 turns by J2 + J3. Base and flange frames stand where the section's
comments say. A number that no source has is left out: many arms have no masses, and some no repeatability.

## A UR's own calibration

Each UR was measured by its maker, and its controller has the result in `~/.urcontrol/calibration.conf`: differences to
the classic Denavit-Hartenberg constants of its kind. `--calibration` takes them into the section exactly: it is checked
on random postures to 1e-9 mm and rad before anything is written. The three nearly parallel axes get Hayati's `beta_deg`
where the file has lengths of hundreds of metres that almost cancel. Centres of mass and limits stay as published.

## An arm from a URDF

```sh
pip install yourdfpy
rig import-urdf arm.urdf -o arm.yaml
```

The six turning joints between two links become modified Denavit-Hartenberg constants, with `beta_deg` where axes are
parallel, held against the URDF library's own forward kinematics to 1e-9 mm and rad before anything is written. The
base is the link `base`, or else the root; the flange is `tool0`, or else the only end: `--base` and `--tip` choose
others. Meshes are not needed. xacro must be expanded first, by ROS's `xacro FILE > arm.urdf`.

Joints count as in the URDF. Where that differs from the controller (many URDFs have a FANUC's J3 as J2 + J3), correct
`coupling`, `offset_deg` and `limits_deg`. Axes that are nearly parallel or nearly at right angles are named and kept as
they are: a URDF that writes 1.571 for a right angle is wrong by 0.2 mm at 1 m.

"""


def page() -> str:
    """The whole page as Markdown."""
    from rigs.arms import arm_names, load_arm  # noqa: PLC0415 - the script first puts the repository on the path

    arms = [load_arm(name) for name in arm_names()]
    lines = [
        "## How far each is from its sources",
        "",
        f"Largest distance and angle of the flange over {POSTURES} random postures within the limits, between the",
        "library and each source computed in its own terms (the joint chain of a URDF, Denavit-Hartenberg rows of",
        "another kind). “Exact” is below 1e-6 mm and rad.",
        "",
        "| arm | source | second | third |",
        "| --- | --- | --- | --- |",
        *(f"| `{arm.name}` | " + " | ".join(_cells(arm)) + " |" for arm in arms),
        "",
        "The Doosan's source writes right angles as 1.571; the library has right angles.",
        "",
        "## Sources",
        "",
    ]
    for arm in arms:
        repeatability = f"; repeatability {arm.repeatability_mm:g} mm" if arm.repeatability_mm else ""
        note = f" {arm.note}" if arm.note else ""
        lines += [f"**{arm.maker} {arm.model}** (`{arm.name}`){repeatability}.{note} Frames: {arm.frames}.", ""]
        sources = arm.sources.model_dump(exclude_defaults=True)
        lines += [f"- {key}: {words}" for key, words in sources.items()]
        lines.append("")
    tail = "This page is generated: `scripts/dev arms_page > docs/arms.md`."
    return HEAD + "\n".join([*lines, tail, ""])


def _cells(arm: Arm) -> Iterator[str]:
    """What the page says of an arm's geometry against each of its sources."""
    from tests.support.second_sources import SOURCES, differences  # noqa: PLC0415

    found = SOURCES[arm.name]
    for key in ("geometry", "second", "third"):
        yield _words(*differences(arm.robot, found[key], POSTURES)) if key in found else ""


def _words(mm: float, rad: float) -> str:
    if mm < EXACT and rad < EXACT:
        return "exact"
    angle = f", {rad * 1e3:.1f} mrad" if rad >= EXACT else ""
    return f"{mm:.3f} mm{angle}"


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    sys.stdout.write(page())
