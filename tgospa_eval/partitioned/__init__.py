"""Evaluation of data larger than memory: blocks of time, then components, then sums.

Here, a *block* is a range of time whose rows are read at once. A *side* is the truth or the
estimate. A *shard* is a group of components that are solved together. The *folder of work* has all
intermediate results. Tracks have indices within a block, and *global numbers* over all blocks. In
names and texts, *truths* are true objects and *estimates* are tracks.
"""
