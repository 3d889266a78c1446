"""Amplitudes of echoes: `amplitude` towards any point, `tiles` at the knots of image lines."""
