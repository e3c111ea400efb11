"""The pictures and tables of each kind of object."""
