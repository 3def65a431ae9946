"""Clouds of weighted particles: Wasserstein distance, and fewer particles."""
