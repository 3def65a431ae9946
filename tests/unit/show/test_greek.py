"""Labels of LaTeX."""

import pytest

from tgospa_eval.show.rendering import latex


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("γ_1", r"\ensuremath{\gamma}\_1"),
        ("Σ α", r"\ensuremath{\Sigma} \ensuremath{\alpha}"),
        ("Αο", "Ao"),
        ("ς λ", r"\ensuremath{\varsigma} \ensuremath{\lambda}"),
    ],
)
def test_greek_letters_have_their_names(text: str, words: str) -> None:
    assert latex(text) == words
