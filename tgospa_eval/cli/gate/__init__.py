"""The verb `gate`."""
