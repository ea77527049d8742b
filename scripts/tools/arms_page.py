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

The library has the constants of these arms, each with the sources of its numbers:

```sh
rig arms                                                  # the table of all
rig arms kuka-kr-6-r900-2                                 # one as the robot section of a rig file
rig arms ur10e --calibration calibration.conf -o arm.yaml # a UR with its own calibration
```

Replace the `robot:` section of a rig file by what `rig arms NAME` shows, and add the `payload_kg` and the `tool` of
your cell. The numbers are those that are published for the model. A real arm differs from them by tenths of a
millimetre to some millimetres; `rig diagnose` and `rig calibrate` find by how much.

Joint angles are those that the controller shows, and `coupling` turns them into the angles of the axes. KUKA's A1 is
positive clockwise, seen from above, so it has -1 there, as A4 and A6 have. FANUC's J3 is measured from the horizontal,
so axis 3 turns by J2 + J3. The comments of a section say where its base and flange frames stand. Numbers without a
source are left out: many arms have no masses, and some have no repeatability.

## A UR's own calibration

The maker measures each UR. The result is in `~/.urcontrol/calibration.conf` on the controller, as differences from the
classic Denavit-Hartenberg constants of the model. `--calibration` adds them to the section. Axes 2, 3 and 4 are nearly
parallel: the file describes them by lengths of hundreds of metres that almost cancel, the section by Hayati's
`beta_deg`. Both give the same poses: random postures are compared to 1e-9 mm and rad before anything is written.
Centres of mass and limits stay as published.

## An arm from a URDF

```sh
pipx install '.[urdf]'                # once, in the clone: with pytransform3d
rig import-urdf arm.urdf --build light -o arm.yaml
```

The chain between two links must have four to seven revolute or continuous joints. They become modified
Denavit-Hartenberg constants, with `beta_deg` where axes are parallel. A prismatic joint below all of them becomes
`robot.rail`; any other is refused, as in a SCARA. A joint that turns without end gets limits of a turn to either side,
and a line that says so. An end behind a joint that is called gripper, jaw, finger or claw is asked for with `--tip`: a
jaw is no axis of the arm. Random postures are compared with the forward kinematics of pytransform3d, to
1e-9 mm and rad, before anything is written. The base is the link `base`, or else the root; the flange is `tool0`, or
else the only end; `--base` and `--tip` choose others. Meshes are not needed. Expand xacro first:
`xacro FILE > arm.urdf`.

Joint angles are those of the URDF. Where the controller counts otherwise, correct `coupling`, `offset_deg` and
`limits_deg`; in many URDFs of a FANUC, the third joint is J2 + J3. `rig import-urdf` names axes that are nearly, but
not exactly, parallel or at right angles, and leaves them as they are. They are often rounding: 1.571 instead of a right
angle moves a point 1 m away by 0.2 mm.

## An arm as a URDF

```sh
rig export-urdf cell.yaml -o arm.urdf
```

This is the way back: the arm of a rig file, with the joint zeros and link constants among its effects, as a URDF for
ROS, simulators and offline programming. Joints turn by the angles that the controller reports, within the limits of
the rig file. The links are `world`, `base_link` (the `base` of the rig file), `link_1` to `link_6`, `flange` and
`tool`. The poses of `tool` are those of the model within 1e-9 mm; tests hold them against pytransform3d and against
twenty lines that multiply matrices.

- Only geometry fits into a URDF. Compliance, waves, plays and growth stay behind. The command and the head of the file
  say how many micrometres the effects move the tool by over the tests of the rig, and how many of them are left out;
  corrected targets of `rig correct` carry more.
- A rig whose `coupling` is more than signs is refused, as for the J2 + J3 of a FANUC: a joint of a URDF turns one axis.
  In a copy of the rig file, set `coupling` to the signs, and turn the controller's angles into those of the axes
  before the URDF sees them.
- A rail is the prismatic joint `rail` below `base_link`, in metres, in URDF, xacro and MJCF; files for a maker's driver
  have none, and the command says so. Its speed is not known and written as 1 m/s. `rig import-urdf` reads it back.
- Masses and their centres are written where the rig file has them. Moments of inertia and torques are not known and are
  0; a simulator of dynamics needs the maker's. There are no meshes.

### For simulators and other descriptions

```sh
rig export-urdf cell.yaml --for xacro -o arm.xacro         # include it, and call the macro with prefix and parent
rig export-urdf cell.yaml --for mjcf -o arm.xml            # for MuJoCo
rig export-urdf cell.yaml --for mjcf --friction-of runs/yaw --nm-per-a K1,K2,K3,K4,K5,K6 -o arm.xml
rig export-urdf cell.yaml --for franka -o kinematics.yaml  # for franka_description; xarm for xarm_description
```

- **MJCF** has what was measured of a joint in hinges of its own on the joint's axis: a *play* turns freely by half
  its width to either side (`NAME_play`), a *compliance* is held by a spring (`NAME_compliance`, torque over angle).
  The hinge with the joint's name turns by the angle that the controller reports, so that this is the one to
  actuate. Friction is the `frictionloss` of that hinge: the motor current that a run shows where the joint turns
  back, times the torque for an ampere (`--nm-per-a`) from the maker's data sheet. Plays that are less than twice
  their u are left out. Moments of inertia are those of a ball of aluminium of each link's mass; a simulator of
  dynamics needs the maker's.
- **kinematics.yaml** of Franka and xArm has each joint's origin in the link frames that the maker's meshes stand
  in. Doosan and Kinova have no such file; take the macro.
- MuJoCo 4.0.0, xacro 2.1.1 and yourdfpy 0.0.60 read the files (`scripts/dev outside_readers`, 26 November 2026), the
  kinematics.yaml by the expressions of the makers' macros: poses of a UR10e, an FR3, an xArm 6 and an xArm 7 with 60
  random errors, on a rail of any way and without, within 1.5e-12 mm of the model, a play of 0.04° as 0.04°.

In Python the same arm is a function, with every effect that depends on the posture alone, and u:

```python
from analysis import calibrated_arm

arm = calibrated_arm("found/cell.yaml")
seen = arm.forward([[0, -90, 90, 0, 90, 0]])  # seen.T in mm, seen.u_mm (NaN where not covered), seen.covered
asked = arm.inverse(seen.T, near_deg=[0, -90, 90, 0, 90, 0])  # asked.q_deg, asked.reached
```

### For the driver of Universal Robots

```sh
rig export-urdf cell.yaml --for ur-driver --hash calib_12788084448423163542 -o calibration.yaml
```

The ROS and ROS 2 drivers describe an arm by a file that their package `ur_calibration` extracts from the controller.
`--for ur-driver` writes such a file with the arm as it was measured; pass it as `kinematics_params_file`. It goes
from the frame `base`, which is the controller's and half a turn about z from the `base_link` of ROS, to `tool0`,
within 1e-9 mm of the model. The `base` and `tool` of the rig file have no place in it: they belong into the URDF of
your cell.

`hash` names a calibration inside the controller, and the driver compares it at each start. rig cannot know it.
Extract the controller's own file first and give its `hash` with `--hash`; you say with this that the new file belongs
to this robot. Without it the file has `rig_not_of_the_controller`, and the driver reports an error at each start,
that the calibration does not match. This is true: the controller's own Cartesian moves still use its own calibration,
while ROS plans with the file's.

"""


def page() -> str:
    """The whole page as Markdown."""
    from rigs.arms import arm_names, load_arm  # noqa: PLC0415 - the script first puts the repository on the path

    arms = [load_arm(name) for name in arm_names()]
    lines = [
        "## How far each is from its sources",
        "",
        f"Largest distance and angle of the flange over {POSTURES} random postures within the limits, between the",
        "library and each source, which is computed as it is written (the joint chain of a URDF, or Denavit-Hartenberg",
        "rows of another kind). “Exact” is below 1e-6 mm and rad.",
        "",
        "| arm | source | second | third |",
        "| --- | --- | --- | --- |",
        *(f"| `{arm.name}` | " + " | ".join(_cells(arm)) + " |" for arm in arms),
        "",
        "The Doosan's source has 1.571 for right angles; the library has right angles.",
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
    sys.path.insert(0, str(Path(__file__).parents[2]))
    sys.stdout.write(page())
