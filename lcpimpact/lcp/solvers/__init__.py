"""One method a file; `lcpimpact.lcp.SOLVERS` lists them by name."""
