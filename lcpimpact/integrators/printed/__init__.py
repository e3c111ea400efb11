"""Steps as printed code: the statements of a step are written once, and printed for one run, for lanes and for a page.

- `straight_line`: the statements of a step, and their text in Python, which is compiled for one run of many steps.
- `lanes`: the text of a run for many sets of parameters side by side, with the coefficients as formulas of them.
- `javascript`: the text of a run for the page with sliders, and its equations as formulas to be read.
"""
