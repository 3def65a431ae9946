"""Many evaluations: which, how they are spread over processes, what is stored, and tables of it."""
