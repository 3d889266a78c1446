"""Backprojection along image lines: `lines` prepares them, `kernels` add echoes."""
