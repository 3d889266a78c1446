"""Backprojection onto arbitrary points: `points` prepares them, `kernels` add echoes."""
