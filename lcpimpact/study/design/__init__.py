"""Design of a block for a required impact, and fits to measurements."""
