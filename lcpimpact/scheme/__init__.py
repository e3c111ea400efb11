"""Rheological schemes: elements, assembly, and equations of motion."""
