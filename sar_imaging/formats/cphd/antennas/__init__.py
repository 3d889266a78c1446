"""Antennas of CPHD files, as the standard says them.

- `writing`: pattern as a table and as polynomials, frames of every vector;
- `polynomials`: the main lobe as a polynomial, and how far that departs;
- `reading`: antennas of files as our patterns and pointing.
"""
