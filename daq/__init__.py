"""The daemon and what it is made of: links, gauges, feedback, the store, emulators. Knows no analysis."""
