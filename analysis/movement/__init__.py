"""What moved between a reference and new readings: causes, odds, sizes, and the touch that separates them best."""
