"""Compiled loops of the methods that are there for comparison: FFBP, omega-k, zero padding."""
