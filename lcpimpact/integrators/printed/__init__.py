"""Steps as printed code: the statements of a step are nodes, and each language prints them.

- `step`: the statements of a step, and the closed form of a law of two rows, as nodes of `lcpimpact.expressions`.
- `straight_line`: their text in Python, which is compiled for one run of many steps.
- `traced_run`: a run with its coefficients as formulas of the parameters.
- `lanes`: the text of a run for many sets of parameters side by side.
- `javascript`: the text of a run for the page with sliders, and its equations as formulas to be read.
"""
