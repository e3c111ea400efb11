"""Rheological schemes: elements, assembly, and the equations of motion that they give."""
