"""The page for decision makers: verdict, findings, charts of each test, and traceability, in a single file."""
