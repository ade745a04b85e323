"""Scores everything against ground truth; nothing here is seen by the system that is scored."""
