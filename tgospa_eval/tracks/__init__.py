"""Trajectories, their states, and the common steps of both sides."""
