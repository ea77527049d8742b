"""A robot's figures over months: kept beside its runs, with the changes that their scatter does not explain."""
