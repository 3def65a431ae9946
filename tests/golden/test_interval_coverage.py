"""The script of docs/theory/intervals.md prints what the page shows, with fewer studies."""

import re
import sys
from importlib import import_module

import pytest
from checkout import DOCS

PAGE = DOCS / "theory" / "intervals.md"
STUDIES = 400


def shares(text: str) -> dict[tuple[str, int], list[float]]:
    """Of each heading and number of truths the shares that cover, by method."""
    found, heading = {}, ""
    for line in text.splitlines():
        if line.startswith(("combined,", "difference,")):
            heading = line
        elif re.match(r" +\d+ ", line):
            size, *values = re.sub(r"\(.*?\)", "", line).split()
            found[heading, int(size)] = [float(value) for value in values]
    return found


def test_the_page_shows_what_the_script_prints(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(DOCS / "theory")
    script = import_module("interval_coverage")
    page = PAGE.read_text(encoding="utf-8").partition("## Rare events in curves")[0]
    whole = shares(page)
    assert {size for _, size in whole} == set(script.SIZES)
    monkeypatch.setattr(sys, "argv", ["", "--studies", str(STUDIES), "--sizes", "6", "20"])
    script.main()
    printed = capsys.readouterr().out
    assert {line for line in printed.splitlines() if " n " in line} <= set(page.splitlines())
    few = shares(printed)
    assert {heading for heading, _ in few} == {heading for heading, _ in whole}
    for key, values in few.items():
        # Four standard deviations of a share of so many studies.
        far = [4 * (share * (1 - share) / STUDIES) ** 0.5 for share in whole[key]]
        assert all(
            abs(value - share) < most
            for value, share, most in zip(values, whole[key], far, strict=True)
        ), key


def test_bands_of_rare_events_cover(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DOCS / "theory")
    script = import_module("rare_events")
    page = PAGE.read_text(encoding="utf-8").partition("## Rare events in curves")[2]
    for law in script.LAWS:
        assert f"cost of an event: {law}" in page
        for size, chance in ((20, 0.01), (60, 0.02), (60, 0.1)):
            assert script.coverage(law, size, chance, 20)[0] > 0.9
    assert all(float(share) > 0.9 for share in re.findall(r"(0\.\d{3}) \(", page))
