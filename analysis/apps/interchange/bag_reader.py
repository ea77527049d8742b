"""Reader of bags of ROS 2, which rig offers as entry point `rig.readers`: a module with the functions of
`analysis.intake.readers.StreamReader`."""

from __future__ import annotations

from analysis.apps.interchange.bags import MCAP_MAGIC, file_of
from analysis.apps.interchange.bags import is_bag as is_own
from analysis.apps.interchange.pose_bag import stands_of_bag as stands_of
from analysis.apps.interchange.ros_bag import table_of_bag as table_of

__all__ = ["file_of", "is_own", "size_remedy", "stands_of", "table_of"]


def size_remedy(data: bytes) -> str:
    """Remedy for a large bag; empty for SQLite, which `mcap filter` does not read."""
    if not data.startswith(MCAP_MAGIC):
        return ""
    return "keep the topics that are read: mcap filter BAG -y /joint_states -y /g1 -y /g2 -o SMALL"
