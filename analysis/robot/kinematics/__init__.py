"""Arm kinematics on stacks of joint angles and poses. Depends on `rigs` only."""
