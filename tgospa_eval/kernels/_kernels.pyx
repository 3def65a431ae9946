# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
# cython: initializedcheck=False, embedsignature=True
"""Compiled loops that would need large temporary arrays in NumPy.

Each section names its *NumPy twin*: the code that does the same if there are no compiled kernels.
Words, letters and shapes are those of `tgospa_eval.solvers`.

All arrays are contiguous, and indices have 32 bits. The loops run without the interpreter lock, and
never on the same rows in two threads, so that results do not depend on the number of threads.
"""

import numpy as np

from libc.math cimport INFINITY, exp, fabs, floor, fmax, fmin, hypot, log, nextafter, rint, sqrt
from libc.stdint cimport int64_t, uint64_t
from libc.string cimport memcpy, memset

from tgospa_eval.errors import check_size
from tgospa_eval.kernels import REGRET as SUM_ERROR

ctypedef int i32
ctypedef unsigned char u8

ctypedef fused Weight:
    double
    u8

cdef double NOTHING = -1e300
cdef double NEVER = 1e300


cdef object full_of(Py_ssize_t size, value, kind=np.int32):
    """Return an array filled with `value`; np.full takes as long as many of the loops here."""
    array = np.empty(size, kind)
    array.fill(value)
    return array


include "states.pxi"
include "ascent.pxi"
include "search.pxi"
