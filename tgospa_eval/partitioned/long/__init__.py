"""One component larger than memory: windows in time, joined, proven as a whole, repaired."""
