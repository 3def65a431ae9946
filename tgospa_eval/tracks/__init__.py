"""Trajectories, their states, and the common steps of truth and estimate."""
