"""Numerical methods that know no mechanics: elimination, banded factors, polynomials, double-double arithmetic."""
