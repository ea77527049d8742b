"""The page for the person who decides: verdict, findings, each test with its pictures, and the trace, in one file."""
