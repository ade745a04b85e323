"""Models of what stands and moves on a street."""
