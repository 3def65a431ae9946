"""Evaluation of data larger than memory: blocks of time, then components, then sums.

In this package, a *block* is a range of time. Its rows are read at once. A *side* is the truth or
the estimate. An *entry* is a near pair of states. A *shard* is a group of components that are
solved together. The *folder of work* has all intermediate results. A track has an index in each
block in which it is, and one *global number* in the whole evaluation. In names and texts, *truths*
are true objects and *estimates* are tracks.
"""
