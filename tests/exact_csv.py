"""CSV files that pandas reads to the last bit."""

import pandas as pd

CSV_OPTIONS = {"encoding": "utf-8-sig"}
"""Options of pandas.read_csv by which every version reads numbers to their last bit."""
if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1):
    CSV_OPTIONS["float_precision"] = "round_trip"
