"""Which single repairs of an estimate would save most of the total, proven."""
