"""Mutated inputs for protocols, readers of files and the control socket."""
