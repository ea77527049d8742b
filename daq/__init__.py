"""Data acquisition.

Folders follow the data: protocol, gauges and feedback (pure), wire, acquisition, store, recording, service. Emulators
and doctor are tools next to them. The package does not import the analysis.
"""
