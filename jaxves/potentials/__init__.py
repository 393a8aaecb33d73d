"""Layer potentials: kernels, self-interaction on one curve, close evaluation."""
