"""Detection of movements between a reference and new readings: causes, odds, sizes, and the most informative next
touch.
"""
