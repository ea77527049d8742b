"""Data acquisition.

The folders follow the flow of data: protocol, gauges and feedback (pure), wire, acquisition, store, recording, service.
Emulators and doctor are tools in addition. The package is independent of the analysis.
"""
