"""The pictures and tables of each kind of object."""

MAX_ROWS = 30
"""Largest number of rows of a table, of tableaus, and of lines of a summary."""

MAX_ORDER = 8
"""Largest number of nodes or contacts with which matrices are shown, and largest order with which tableaus are."""
