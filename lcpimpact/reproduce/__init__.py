"""The paper reproduced: its figures, the cross-validation, and one report that opens offline."""
