"""Sweeps: one problem run for many sets of parameters, in chunks, by any executor, into memory or a store.

How a chunk is run is the business of `job` alone; grids, samples, executors, storage and progress do not know it.
"""
