"""LCP methods, one per file; `lcpimpact.lcp.SOLVERS` lists them by name."""
