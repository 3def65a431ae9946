"""Which column is what: headers, as they are asked for and found, to roles."""
