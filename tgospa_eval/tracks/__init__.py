"""What is compared: trajectories, their states, and the steps that both sides share."""
