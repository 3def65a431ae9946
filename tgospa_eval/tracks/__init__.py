"""Trajectories, their states, and the steps that both sides share."""
