"""Studies: what is done with many runs."""
