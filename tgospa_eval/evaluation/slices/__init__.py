"""An evaluation split by attributes: what is asked for, values, bins, sums."""
