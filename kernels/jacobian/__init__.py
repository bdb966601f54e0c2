"""The dense image Jacobian's filter and its state, DIJE (9) to (14)."""
