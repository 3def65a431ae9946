"""What runs where the kernels were not built."""
