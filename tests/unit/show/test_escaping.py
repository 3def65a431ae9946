"""What a user wrote stays text, whatever shows it."""

import pickle

import pytest

from tgospa_eval import InputError
from tgospa_eval.quoting import clipped, listed, quoted, visible, visible_lines
from tgospa_eval.show import table_text as escape


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\nb\r\x1b[31m\x9b1m\x7f", r"a\nb\r\x1b[31m\x9b1m\x7f"),
        ("a\u202eb\u2066\u200b\u2028\ud800", r"a\u202eb\u2066\u200b\u2028\ud800"),
        ("::error::x ::y a::b", r"\x3a:error::x \x3a:y a::b"),
        ("##[error] a##vso[task]", r"\x23#[error] a\x23#vso[task]"),
        ("##teamcity[x] ## b", r"\x23#teamcity[x] ## b"),
        ("é 漢 שלום 😀 \\n", "é 漢 שלום 😀 \\n"),
    ],
)
def test_visible(text: str, shown: str) -> None:
    assert visible(text) == shown == visible(shown)


def test_lines_and_tabs_remain_where_they_are_ours() -> None:
    assert visible_lines("a\tb\n\t::c\n") == "a\tb\n\t\\x3a:c\n"


def test_quoted_has_at_most_60_characters() -> None:
    assert quoted("a" * 60) == f'"{"a" * 60}"'
    assert quoted("a" * 61) == f'"{"a" * 57}..."'
    assert quoted("\x00" * 10**6) == clipped("\x00" * 20).join('""')
    assert listed("abc") == "a, b, c"
    assert listed(range(15)) == "0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11 and 3 more"


def test_an_error_shows_all_that_it_quotes() -> None:
    error = InputError("a\n.csv: wrong", "b\x1b.csv: wrong")
    assert str(error) == "a\\n.csv: wrong\nb\\x1b.csv: wrong"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_markdown() -> None:
    assert escape.markdown("*a* _b_ <i>|$x$&") == r"\*a\* \_b\_ &lt;i>\|\$x\$&amp;"
    assert escape.markdown("see http://x, www.x.org") == r"see http\://x, www\.x.org"
    assert escape.markdown("@me, me@here") == "@&#8203;me, me@here"


def test_csv_cells_are_no_formulas_and_can_be_had_back() -> None:
    texts = ["=cmd()", "+x", "@x", "-", "\tx", "'=x", "''-", "-1", "+.5e3", "1", "it's", "'", ""]
    cells = list(map(escape.csv_cell, texts))
    assert cells[:7] == [f"'{text}" for text in texts[:7]]
    assert cells[7:] == texts[7:]
    assert [escape.csv_cell(value) for value in (-1, -1.5, None)] == [-1, -1.5, None]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("γ_1", r"\ensuremath{\gamma}\_1"),
        ("Σ α", r"\ensuremath{\Sigma} \ensuremath{\alpha}"),
        ("Ϸ Ͱ", "Ϸ Ͱ"),
        ("Αο", "Ao"),
        ("ς λ", r"\ensuremath{\varsigma} \ensuremath{\lambda}"),
    ],
)
def test_greek_letters_of_latex_have_their_names(text: str, words: str) -> None:
    assert escape.latex(text) == words
