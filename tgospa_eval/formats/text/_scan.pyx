# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
# cython: initializedcheck=False, embedsignature=True
"""The fields of a plain table in one pass; `gather` in formats.text.convert is the careful way."""

import numpy as np

from cpython.unicode cimport PyUnicode_DecodeASCII
from libc.math cimport INFINITY, NAN
from libc.stdint cimport int64_t, uint64_t
from libc.string cimport memcmp

cdef extern from "Python.h":
    double PyOS_string_to_double(const char *text, char **end, void *overflow) except? -1.0

cdef extern from "float.h":
    int FLT_EVAL_METHOD

ctypedef unsigned char u8

cdef double[23] POWERS = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
]
cdef uint64_t EXACT = <uint64_t>1 << 53
cdef enum:
    NUMBER = 1  # of `kinds`
    TEXT = 2
    MOST_DIGITS = 19  # of 64 bits
    LONGEST = 120


cdef inline bint is_digit(const char* at, const char* stop) noexcept:
    return at < stop and c'0' <= at[0] <= c'9'


cdef double slowly(const char* at, const char* stop, char decimal) except? -1.0:
    """The double of a number of any length as Python reads it; infinite where it is none."""
    cdef char[LONGEST + 1] text
    cdef char* end
    cdef Py_ssize_t length = stop - at, k
    cdef double value
    if length > LONGEST:
        return INFINITY
    for k in range(length):
        text[k] = c'.' if at[k] == decimal else at[k]
    text[length] = 0
    value = PyOS_string_to_double(text, &end, NULL)
    return value if end == text + length else INFINITY


cdef const char* number(
    const char* at, const char* stop, char delimiter, char decimal, double* value, Py_ssize_t* long_
) except? NULL:
    """The end of the field, whose number is written to `value`, NaN where blank; NULL where odd.

    A mantissa up to 2^53 times or through a power of ten up to 10^22: both are doubles, so that
    the one operation rounds correctly (Clinger, How to read floating point numbers accurately,
    PLDI 1990). Python reads what has more digits, and `long_` counts it.
    """
    cdef const char* begin
    cdef const char* end
    cdef uint64_t mantissa = 0
    cdef int digits = 0, scale = 0, exponent = 0
    cdef bint negative = False, some = False, whole = True, minus
    while delimiter != c' ' and at < stop and at[0] == c' ':
        at += 1
    begin = at
    if at < stop and (at[0] == c'-' or at[0] == c'+'):
        negative = at[0] == c'-'
        at += 1
    while is_digit(at, stop):
        some = True
        if digits < MOST_DIGITS:
            mantissa = 10 * mantissa + <uint64_t>(at[0] - c'0')
            digits += mantissa > 0
        else:
            whole = False
        at += 1
    if at < stop and at[0] == decimal:
        at += 1
        while is_digit(at, stop):
            some = True
            if digits < MOST_DIGITS:
                mantissa = 10 * mantissa + <uint64_t>(at[0] - c'0')
                digits += mantissa > 0
                scale -= 1
            else:
                whole = False
            at += 1
    if some and at < stop and (at[0] == c'e' or at[0] == c'E'):
        at += 1
        minus = at < stop and at[0] == c'-'
        if at < stop and (at[0] == c'-' or at[0] == c'+'):
            at += 1
        if not is_digit(at, stop):
            return NULL
        while is_digit(at, stop):
            if exponent < 10000:
                exponent = 10 * exponent + (at[0] - c'0')
            at += 1
        scale += -exponent if minus else exponent
    end = at
    if not some and at == begin and stop - at >= 3:
        if (at[0] | 32) == c'n' and (at[1] | 32) == c'a' and (at[2] | 32) == c'n':
            at += 3
            begin = at
    while delimiter != c' ' and at < stop and at[0] == c' ':
        at += 1
    if at < stop and at[0] != delimiter and at[0] != c'\n':
        return NULL
    if not some:
        if end != begin and end + 3 != begin:  # a sign or a mark alone
            return NULL
        value[0] = NAN
        return at
    if whole and mantissa <= EXACT and -22 <= scale <= 22 and FLT_EVAL_METHOD == 0:
        value[0] = <double>mantissa
        if scale < 0:
            value[0] /= POWERS[-scale]
        else:
            value[0] *= POWERS[scale]
        if negative:
            value[0] = -value[0]
        return at
    long_[0] += 1
    value[0] = slowly(begin, end, decimal)
    return at if -INFINITY < value[0] < INFINITY else NULL


cdef class Coder:
    """Numbers of the distinct texts of a column, in the order of appearance.

    Tables go round: a text is that of the row before, or the one that came after that text before.
    """

    cdef dict seen
    cdef int64_t last
    cdef int64_t[::1] begin, length, after

    def __cinit__(self, Py_ssize_t rows):
        self.seen = {}
        self.last = -1
        self.begin, self.length, self.after = np.empty((3, rows), np.int64)

    cdef bint is_text(self, int64_t code, const char* data, const char* at, Py_ssize_t length):
        return self.length[code] == length and not memcmp(data + self.begin[code], at, length)

    cdef int64_t code(self, const char* data, const char* at, Py_ssize_t length) except -1:
        cdef int64_t last = self.last, code = -1
        if last >= 0:
            if self.is_text(last, data, at, length):
                return last
            code = self.after[last]
            if code >= 0 and self.is_text(code, data, at, length):
                self.last = code
                return code
        text = PyUnicode_DecodeASCII(at, length, NULL)
        code = self.seen.setdefault(text, len(self.seen))
        if code == <int64_t>len(self.seen) - 1:  # new; or the newest again, of the same letters
            self.begin[code], self.length[code] = at - data, length
            self.after[code] = -1
        if last >= 0:
            self.after[last] = code
        self.last = code
        return code


def scan(
    bytes data, Py_ssize_t start, str delimiter, str decimal, const u8[::1] kinds,
    Py_ssize_t most_long,
):
    """Columns of numbers (n, R), and of texts: codes (k, R) and the distinct texts of each.

    None if some row has more or fewer fields than there are `kinds` (1 for numbers, 2 for texts,
    3 for both, 0 for what is passed over), a field is not plainly a number or blank, or more than
    `most_long` numbers are left to Python. `data` is ASCII text without quotes and carriage
    returns, of which the rows begin at `start`.
    """
    cdef const char* base = data
    cdef const char* at = base + start
    cdef const char* stop = base + len(data)
    cdef const char* begin
    cdef const char* end = NULL
    cdef char mark = ord(delimiter), point = ord(decimal)
    cdef Py_ssize_t width = kinds.shape[0], row = 0, long_ = 0, rows, k, n, j
    while stop > at and stop[-1] == c'\n':
        stop -= 1
    if stop == at:
        return None
    rows = data.count(b"\n", start, stop - base) + 1
    found = np.empty((sum(kind & NUMBER for kind in kinds), rows))
    codes = np.empty((sum(kind >> 1 for kind in kinds), rows), np.int64)
    cdef double[:, ::1] value = found
    cdef int64_t[:, ::1] code = codes
    cdef list coders = [Coder(rows) for _ in range(len(codes))]
    while True:
        n = j = 0
        for k in range(width):
            begin = at
            if kinds[k] & NUMBER:
                at = number(begin, stop, mark, point, &value[n, row], &long_)
                if at == NULL or long_ > most_long:
                    return None
                n += 1
            else:
                while at < stop and at[0] != mark and at[0] != c'\n':
                    at += 1
            if kinds[k] & TEXT:
                code[j, row] = (<Coder>coders[j]).code(base, begin, at - begin)
                j += 1
            if k < width - 1:
                if at == stop or at[0] != mark:
                    return None
                at += 1
        if at < stop and at[0] != c'\n':
            return None
        row += 1
        if at == stop:
            break
        at += 1
    return found, codes, [list((<Coder>coder).seen) for coder in coders]
