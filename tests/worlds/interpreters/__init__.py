"""Programs in five languages, run by the interpreters of rig on independently computed arms."""
