"""The proving ground: tasks that any program can enter, as plain CSV, and the scorer (docs/proving-ground.md)."""
