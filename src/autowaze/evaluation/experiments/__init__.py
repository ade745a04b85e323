"""Experiments as the thesis ran them (sec. 4.1): many drives through streets with known truth, every method judged."""
