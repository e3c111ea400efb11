"""Studies that combine several runs."""
