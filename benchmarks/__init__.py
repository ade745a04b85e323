"""Measured figures of the docs: each module offers `run() -> None`, which prints a table."""
