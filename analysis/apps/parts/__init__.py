"""3D-printed parts for touches and the link: solids, drawing and parts list from a rig file."""
