"""The arm and its kinematics, on stacks of joint angles and poses. Imports nothing of ours but `rigs`."""
