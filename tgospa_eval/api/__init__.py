"""What people and the command line ask for, and what they get."""
