"""The experiments of the paper on dense image Jacobian estimation (DIJE)."""
