"""Simulated scenes, echoes and the papers' scenarios."""
