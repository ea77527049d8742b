"""The figures of Oh 2019 beside those of one simulated robot (`rig paper`); nothing is stored, all is computed."""
