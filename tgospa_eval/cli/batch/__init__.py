"""The verb `batch`."""
