# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
# cython: initializedcheck=False, embedsignature=True
"""Reading of a plain table in one pass; `formats.text.lines` reads tables that are not plain."""

import numpy as np

from cpython.unicode cimport PyUnicode_DecodeUTF8
from libc.math cimport INFINITY, NAN
from libc.stdint cimport int64_t, uint64_t
from libc.string cimport memcmp, memcpy

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
    NUMBER = 1  # value of `kinds`
    TEXT = 2
    MOST_DIGITS = 19  # any number of 19 digits fits 64 bits
    LONGEST = 120
    SCALES = 65  # `nearest` multiplies by powers of ten from -64 to 64
    PLAIN = 0  # value of `letters`
    ENDS = 1
    ODD = 2

cdef uint64_t[2 * SCALES - 1] HIGH, LOW
"""Upper and lower half of the first 128 bits of the powers of five from -64 to 64, as in Lemire."""


def _powers_of_five():
    for k in range(2 * SCALES - 1):
        power = 5 ** abs(k - SCALES + 1)
        length = power.bit_length()
        if k >= SCALES - 1:
            bits = power << 128 >> length
        elif k >= SCALES - 28:
            bits = (1 << (length + 127)) // power + 1
        else:
            bits = (1 << (2 * length + 128)) // power + 1
            bits >>= bits.bit_length() - 128
        HIGH[k], LOW[k] = bits >> 64, bits & (2**64 - 1)


_powers_of_five()


cdef inline uint64_t product(uint64_t one, uint64_t two, uint64_t* high) noexcept:
    """Return the lower 64 bits of a product, and write the upper 64 bits to `high`."""
    cdef uint64_t half = 0xFFFFFFFF
    cdef uint64_t low = (one & half) * (two & half)
    cdef uint64_t first = (one >> 32) * (two & half) + (low >> 32)
    cdef uint64_t second = (one & half) * (two >> 32) + (first & half)
    high[0] = (one >> 32) * (two >> 32) + (first >> 32) + (second >> 32)
    return (second << 32) | (low & half)


cdef double nearest(uint64_t mantissa, int scale) noexcept:
    """Return the double nearest to mantissa * 10^scale, for a mantissa > 0 and scales of -64 to 64.

    The algorithm is that of Eisel and Lemire: Lemire, Number parsing at a gigabyte per second,
    Software: Practice and Experience 51 (2021). 128 bits of the power of five suffice: Mushtak and
    Lemire, Fast number parsing without fallback, Software: Practice and Experience 53 (2023).
    """
    cdef uint64_t high, low, more, bits
    cdef int zeros = 0, step = 32, upper, exponent
    cdef double value
    while step:  # leading zeros of the mantissa
        if mantissa >> (64 - step) == 0:
            mantissa <<= step
            zeros += step
        step >>= 1
    low = product(mantissa, HIGH[scale + SCALES - 1], &high)
    if high & 0x1FF == 0x1FF:
        product(mantissa, LOW[scale + SCALES - 1], &more)
        low += more
        high += low < more
    upper = high >> 63
    bits = high >> (upper + 9)
    exponent = ((217706 * scale) >> 16) + 63 + upper - zeros + 1023
    if low <= 1 and -4 <= scale <= 23 and bits & 3 == 1 and bits << (upper + 9) == high:
        bits &= ~<uint64_t>1  # half way between two doubles: round to the even one
    bits = (bits + (bits & 1)) >> 1
    if bits >= EXACT:
        bits = EXACT >> 1
        exponent += 1
    bits = (bits & ~(EXACT >> 1)) | (<uint64_t>exponent << 52)
    memcpy(&value, &bits, 8)
    return value


cdef inline bint is_digit(const char* at, const char* stop) noexcept:
    return at < stop and c'0' <= at[0] <= c'9'


cdef double slowly(const char* at, const char* stop, char decimal) except? -1.0:
    """Return the double that Python reads from a text, or infinity if it is not a number."""
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
    const char* at, const char* stop, const u8* letters, char decimal, double* value
) except? NULL:
    """Write the number of a field to `value`, NaN if blank, and return the end of the field.

    Return NULL if the field is neither a plain number nor blank. A mantissa up to 2^53 is
    multiplied or divided by a power of ten up to 10^22. Both are doubles, so this one operation
    rounds correctly (Clinger, How to read floating point numbers accurately, PLDI 1990). `nearest`
    reads other numbers of up to 19 digits and powers of ten from -64 to 64. Python reads the rest.
    """
    cdef const char* begin
    cdef const char* end
    cdef uint64_t mantissa = 0
    cdef int digits = 0, scale = 0, exponent = 0
    cdef bint negative = False, some = False, whole = True, minus
    while at < stop and at[0] == c' ' and letters[c' '] == PLAIN:
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
    while at < stop and at[0] == c' ' and letters[c' '] == PLAIN:
        at += 1
    if at < stop and letters[<u8>at[0]] != ENDS:
        return NULL
    if not some:
        if end != begin and end + 3 != begin:  # only a sign or a decimal mark
            return NULL
        value[0] = NAN
        return at
    if whole and mantissa <= EXACT and -22 <= scale <= 22 and FLT_EVAL_METHOD == 0:
        value[0] = <double>mantissa
        if scale < 0:
            value[0] /= POWERS[-scale]
        else:
            value[0] *= POWERS[scale]
    elif whole and mantissa > 0 and -SCALES < scale < SCALES:
        value[0] = nearest(mantissa, scale)
    else:
        value[0] = slowly(begin, end, decimal)
        return at if -INFINITY < value[0] < INFINITY else NULL
    if negative:
        value[0] = -value[0]
    return at


cdef class Coder:
    """Codes of the distinct texts of a column: 0, 1, ... in order of appearance.

    Texts of tables repeat in cycles. So a text is first compared with the text of the row before.
    Then it is compared with the text that came after that one the last time.
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
        text = PyUnicode_DecodeUTF8(at, length, NULL)
        code = self.seen.setdefault(text, len(self.seen))
        if code == <int64_t>len(self.seen) - 1:  # a new text, or the newest of all texts again
            self.begin[code], self.length[code] = at - data, length
            self.after[code] = -1
        if last >= 0:
            self.after[last] = code
        self.last = code
        return code


cdef bint is_marked(const char* at, const char* stop) noexcept:
    """Return whether a row begins with a mark of comments, perhaps behind a quote."""
    cdef bint quoted = False
    while at < stop and (at[0] == c' ' or at[0] == c'\t' or (at[0] == c'"' and not quoted)):
        quoted |= at[0] == c'"'
        at += 1
    if at < stop and (at[0] == c'#' or at[0] == c'%'):
        return True
    return at + 1 < stop and at[0] == c'/' and at[1] == c'/'


def scan(
    bytes data, Py_ssize_t start, str delimiter, str decimal, const u8[::1] kinds, bint quotes
):
    """Read the R rows of a plain table.

    Return the numbers (n, R) of n columns, the codes (k, R) of the texts of k columns, and the
    distinct texts of each of these columns.

    Return None if the table is not plain. This is so in these cases:

    - A row begins like a comment, or has another number of fields than `kinds`.
    - A field of numbers is neither a plain number nor blank.
    - A field has a quote or a line end inside.
    - `quotes` is False, and a field is in quotes or the last field is blank.

    `kinds` has a number for each column: 1 for numbers, 2 for texts, 3 for both, and 0 for columns
    to skip. `data` is UTF-8, and rows begin at `start`. A blank as delimiter means any number of
    blanks and tabs.
    """
    cdef const char* base = data
    cdef const char* at = base + start
    cdef const char* stop = base + len(data)
    cdef const char* begin
    cdef const char* end
    cdef char mark = ord(delimiter), point = ord(decimal)
    cdef bint blanks = mark == c' '
    cdef u8[256] letters
    cdef Py_ssize_t width = kinds.shape[0], row = 0, rows, k, n, j
    for k in range(256):
        letters[k] = ODD if (k < 32 and k != 9) or k == c'"' or (blanks and k > 127) else PLAIN
    letters[<u8>mark] = letters[c'\n'] = letters[c'\r'] = ENDS
    if blanks:
        letters[c'\t'] = ENDS
    while stop > at and (stop[-1] == c'\n' or stop[-1] == c'\r'):
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
        if is_marked(at, stop):
            return None
        n = j = 0
        for k in range(width):
            while blanks and at < stop and (at[0] == c' ' or at[0] == c'\t'):
                at += 1
            begin = at
            if at < stop and at[0] == c'"':
                if not quotes:
                    return None
                begin += 1
                at += 1
                while at < stop and at[0] != c'"' and at[0] != c'\n' and at[0] != c'\r':
                    at += 1
                if at == stop or at[0] != c'"':
                    return None
                end = at
                at += 1
                if at < stop and letters[<u8>at[0]] != ENDS:
                    return None
            else:
                if kinds[k] != NUMBER:
                    while at < stop and letters[<u8>at[0]] == PLAIN:
                        at += 1
                    if at < stop and letters[<u8>at[0]] == ODD:
                        return None
                end = at
            if kinds[k] & NUMBER:
                if kinds[k] == NUMBER and at == begin:
                    at = end = number(begin, stop, letters, point, &value[n, row])
                    if at == NULL:
                        return None
                elif number(begin, end, letters, point, &value[n, row]) != end:
                    return None
                n += 1
            if kinds[k] & TEXT:
                code[j, row] = (<Coder>coders[j]).code(base, begin, end - begin)
                j += 1
            if blanks:
                if at == begin:
                    return None  # the row has too few fields
                while at < stop and (at[0] == c' ' or at[0] == c'\t'):
                    at += 1
            elif k < width - 1:
                if at == stop or at[0] != mark:
                    return None
                at += 1
        if not quotes and not blanks and (at[-1] == mark or at[-1] == c' ' or at[-1] == c'\t'):
            return None
        row += 1
        if at == stop:
            break
        if at[0] == c'\r':
            at += 1
        if at == stop or at[0] != c'\n':
            return None
        at += 1
        if at == stop:
            return None
    return (found, codes, [list((<Coder>coder).seen) for coder in coders]) if row == rows else None
