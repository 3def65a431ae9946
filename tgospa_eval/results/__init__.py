"""What a user holds of an evaluation."""
