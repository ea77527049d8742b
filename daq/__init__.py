"""Data acquisition. Folders follow the data: protocol, gauges and feedback (pure), wire, acquisition, store, recording,
service; emulators and doctor stand beside them. It imports nothing of the analysis."""
