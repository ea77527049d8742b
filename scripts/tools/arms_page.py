"""Generate docs/arms.md from the arm library and independent data: `scripts/dev arms_page > docs/arms.md`.

Each arm is compared with its independent sources on 1000 random postures within its limits.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigs.arms import LibraryArm

POSTURES = 1000
EXACT = 1e-6
"""Difference in mm and rad below which two sources agree: rounding of the published numbers, which varies between
computers.
"""
HEAD = """\
# The arm library

The library has the published constants of the [arms below](#the-arms):

```sh
rig arms                                                  # list all arms
rig arms kuka-kr-6-r900-2                                 # one arm as the robot section of a rig file, with its sources
rig arms ur10e --calibration calibration.conf -o arm.yaml # a UR with its individual calibration
```

Replace the `robot:` section of a rig file by the output of `rig arms NAME`, and add the `payload_kg` and the `tool` of
your cell. Values without a source are omitted: many arms have no masses, and some have no repeatability. The comments
of a section describe the base and flange frames and warn about similar models.

Joint angles are those of the controller, and `coupling` converts them to the angles of the axes. KUKA's A1 is positive
clockwise, seen from above, so its entry is -1, as for A4 and A6. FANUC's J3 is measured from the horizontal, so axis 3
turns by J2 + J3.

**A UR with its calibration.** `--calibration` adds the [constants in the controller](controller.md). The file of the
controller describes the nearly parallel axes 2, 3 and 4 by lengths of hundreds of metres that almost cancel, the
section by Hayati's `beta_deg`.

## An arm from a URDF

```sh
pipx install '.[urdf]'                # once, in the clone; installs pytransform3d
rig import-urdf arm.urdf --build light -o arm.yaml
```

Expand xacro first: `xacro FILE > arm.urdf`. Meshes are not needed. The base is the link `base` or the root, the flange
`tool0` or the only end; `--base` and `--tip` select others. The chain between them must have four to seven revolute or
continuous joints, which become modified Denavit-Hartenberg constants.

- A prismatic joint below all of them becomes `robot.rail`. Other prismatic joints are refused, as in a SCARA.
- A continuous joint gets limits of a turn in both directions.
- If the end is behind a joint called gripper, jaw, finger or claw, `--tip` is required: a jaw is no axis of the arm.
- Joint angles are those of the URDF. If the controller counts differently, correct `coupling`, `offset_deg` and
  `limits_deg`. In many URDFs of a FANUC, the third joint is J2 + J3.
- Axes that are nearly parallel or perpendicular are named and not changed. The cause is often rounding: 1.571 instead
  of a right angle moves a point at 1 m by 0.2 mm.

## An arm as a URDF

```sh
rig export-urdf cell.yaml -o arm.urdf                      # for ROS, simulators and offline programming
rig export-urdf cell.yaml --for xacro -o arm.xacro         # a macro with prefix and parent
rig export-urdf cell.yaml --for mjcf -o arm.xml            # for MuJoCo
rig export-urdf cell.yaml --for mjcf --friction-of runs/yaw --nm-per-a K1,K2,K3,K4,K5,K6 -o arm.xml
rig export-urdf cell.yaml --for franka -o kinematics.yaml  # for franka_description; xarm for xarm_description
```

The file contains the arm of a rig file, including joint zeros and link constants among its effects. Joints turn by the
angles of the controller. The links are `world`, `base_link` (the `base` of the rig file), `link_1` to `link_6`,
`flange` and `tool`.

- A URDF contains only geometry, no compliance, waves, backlash or thermal growth. The command and the head of the file
  state how much is omitted. Corrected targets of `rig correct`, and [`calibrated_arm`](api.md#calibrated_arm) in
  Python, contain more.
- A rig whose `coupling` has more than signs is refused, as for J2 + J3 of a FANUC, because a joint of a URDF turns one
  axis. Set `coupling` to the signs in a copy of the rig file, and convert the angles of the controller.
- A rail is the prismatic joint `rail` below `base_link`, in metres, in URDF, xacro and MJCF. The speed is unknown and
  written as 1 m/s. Files for the driver of a maker have no rail.
- Masses and centres are written if the rig file has them. Moments of inertia and torques are unknown and written as 0:
  a dynamics simulator needs the values of the maker. There are no meshes.
- **MJCF** has additional hinges for measured effects on the axis of a joint: *backlash* turns freely by half its width
  in both directions (`NAME_play`), *compliance* is a spring (`NAME_compliance`). Actuate the hinge with the name of the
  joint. Its `frictionloss` is the motor current at the reversals of a run (`--friction-of`) times the torque per ampere
  of the data sheet (`--nm-per-a`). Moments of inertia are those of an aluminium ball with the mass of the link.
- **kinematics.yaml** has the origin of each joint in the link frames of the maker's meshes. Doosan and Kinova have no
  such file; use the macro.

MuJoCo, xacro and yourdfpy [read these files](evidence/reach.md).

### For the driver of Universal Robots

```sh
rig export-urdf cell.yaml --for ur-driver --hash calib_12788084448423163542 -o calibration.yaml
```

Pass the file to the ROS or ROS 2 driver as `kinematics_params_file`. It describes the chain from the frame `base` of
the controller (half a turn about z from the `base_link` of ROS) to `tool0`. Add the `base` and `tool` of the rig file
to the URDF of your cell.

`hash` identifies the calibration in the controller. Extract the file of the controller with `ur_calibration` and pass
its `hash`; otherwise the driver reports at each start that the calibration does not match. Cartesian moves of the
controller still use the stored calibration, while ROS plans with the file.

"""


def page() -> str:
    """Return the complete page as Markdown."""
    from rigs.arms import arm_names, load_arm  # noqa: PLC0415 - the script first puts the repository on the path

    arms = [load_arm(name) for name in arm_names()]
    lines = [
        "## The arms",
        "",
        "| maker | arms |",
        "| --- | --- |",
        *(
            f"| {maker} | {', '.join(f'`{one.name}`' for one in arms if one.maker == maker)} |"
            for maker in _makers(arms)
        ),
        "",
        "The flange agrees with two or three sources in their original form (the joint chain of a URDF, or other",
        f"Denavit-Hartenberg rows) within 1e-6 mm and rad over {POSTURES} random postures. Exceptions, with the",
        "largest distance and angle:",
        "",
        "| arm | source | second | third |",
        "| --- | --- | --- | --- |",
        *filter(None, map(_row, arms)),
        "",
        "The source of the Doosan has 1.571 for right angles; the library has right angles.",
        "",
        *_differences(),
        "",
        "This page is generated: `scripts/dev arms_page > docs/arms.md`.",
        "",
    ]
    return HEAD + "\n".join(lines)


def _makers(arms: list[LibraryArm]) -> list[str]:
    return list(dict.fromkeys(one.maker for one in arms))


def _row(arm: LibraryArm) -> str:
    """Row of an arm that differs from a source; empty if it agrees with all of them."""
    cells = list(_cells(arm))
    return f"| `{arm.name}` | {' | '.join(cells)} |" if {*cells} - {"exact", ""} else ""


def _differences() -> Iterator[str]:
    """Yield the section on typical differences from the data sheet, by family and by design."""
    from rigs.families import families  # noqa: PLC0415

    yield "## Typical differences from the data sheet"
    yield ""
    yield "A sound arm differs from its data sheet by about these values (rms of several arms, and the largest),"
    yield "in mm for lengths `a` and `d`, in degrees for twists `alpha` and `beta` ([the arm in the"
    yield "controller](controller.md)). Constants that poses cannot separate share a row."
    for family in families().families:
        yield from ("", f"**{family.name}**: {family.source}.", "")
        yield from ("| constant | rms | largest | arms |", "| --- | --- | --- | --- |")
        for row in family.constants:
            yield f"| {', '.join(row.seats)} | {row.rms:g} | {row.largest:g} | {row.arms} |"
    yield from ("", "**Other arms**, by `build`:", "")
    yield from ("| build | length | twist | arms | source |", "| --- | --- | --- | --- | --- |")
    for build, sizes in families().designs.items():
        yield f"| `{build}` | {sizes.length_mm:g} mm | {sizes.angle_deg:g}° | {sizes.arms} | {sizes.source} |"


def _cells(arm: LibraryArm) -> Iterator[str]:
    """Yield the comparison of an arm's geometry with each of its sources, as table cells."""
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
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests.support.markdown import wrapped

    sys.stdout.write(wrapped(page()))
