"""Where tasks are done: processes of this machine, workers of a cluster."""
