"""3D-printed parts for touch tests and the link: solids, a drawing and a parts list from a rig file."""
