"""Kinematics of arms, for stacks of joint angles and poses. Depends on `rigs` only."""
