"""The problems with closed forms as data: files that any other program can read."""
