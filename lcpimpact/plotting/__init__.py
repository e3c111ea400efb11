"""Drawings and plots; with the command line, the only package that imports matplotlib (and never pyplot)."""
