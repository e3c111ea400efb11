"""Suites of cases that others published, run again, each with the numbers of its source."""
