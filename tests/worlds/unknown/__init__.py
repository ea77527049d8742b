"""Robot cells with one cause of error that rig's library of effects does not contain.

Nothing in this package imports rig. `arms` has the kinematics, `causes` the physics of the causes, `motion` the paths,
`readings` the instruments, `cells` the drawn cells, `files` the tables and rig files that rig reads.
"""
