"""Reports of a gate: table of 80 characters, JSON, Markdown, GitHub, JUnit XML and pages."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from textwrap import TextWrapper
from urllib.parse import quote

from tgospa_eval.campaign.gate.outcome import PairOutcome, Report, texts
from tgospa_eval.campaign.gate.rules import SEVERITY, Finding, Inference, Verdict
from tgospa_eval.campaign.gate.suite import ONLY_PAIR, SEED
from tgospa_eval.common.config import settings_field
from tgospa_eval.common.files import is_missing, named, patience
from tgospa_eval.common.words import counted, natural, number
from tgospa_eval.errors import ConfigError, ExitStatus
from tgospa_eval.quoting import clipped, ending, listed, option, visible
from tgospa_eval.results.records import Json, json_text
from tgospa_eval.show import table_text

SCHEMA = "tgospa-eval/gate/1"
WIDTHS = (16, 20, 11, 11, 11, 0)
"""Widths of the columns: pair, rule, three numbers, verdict."""


def title(outcome: PairOutcome) -> str:
    """Return the title of a pair or a group."""
    if outcome.group:
        return f"group {outcome.name}"
    return outcome.estimate if outcome.name == ONLY_PAIR and outcome.estimate else outcome.name


def headline(report: Report) -> str:
    """Return the verdict and the counts of all verdicts, in one line."""
    parts = [f"{count} {what}" for what, count in report.tally.items()]
    for kind, group in (("group", True), ("pair", False)) if not parts else ():
        of_kind = [one.verdict for one in report.outcomes if one.group is group]
        named = any(one.group for one in report.outcomes)
        for verdict in (one for one in Verdict if one in of_kind):
            count = of_kind.count(verdict)
            parts.append(f"{counted(count, kind) if named else count} {in_words(verdict)}")
    counts = f": {', '.join(parts)}" if len(report.outcomes) > 1 or report.tally else ""
    warned = sum(
        bool(one.warnings) or any(f.rule.warns for f in one.warned) for one in report.outcomes
    )
    counts += f"; with warnings: {warned:,}" if warned else ""
    return f"gate: {report.verdict} (exit status {report.status}){counts}"


FIRST = (Verdict.FAIL, Verdict.ERROR, Verdict.INCOMPARABLE, Verdict.UNDECIDED)


def worst_first(row: tuple[PairOutcome, str, tuple[float | None, ...], str, bool]) -> int:
    """Return a sort key that puts the worst verdicts first, for a row of `rows_of`."""
    return FIRST.index(Verdict(row[3])) if row[3] in FIRST else len(FIRST)


UNPROVEN = "the reported split, not proven: another assignment may have the same total"
"""Note on values that are marked as not proven."""

LIMITS = ("baseline", "limit", "now")


def rows_of(
    report: Report,
) -> Iterator[tuple[PairOutcome, str, tuple[float | None, ...], str, bool]]:
    """Yield a row for each rule: outcome, text, numbers, verdict, and whether the value is proven.

    The numbers are those of the baseline, of the limit, and of this run. An update has a row for
    each changed value instead, with the value before and after. An outcome that could not be judged
    has a single row without numbers. A new pair has a row with its total. A pair that passes
    without findings has no row.
    """
    for outcome in report.outcomes:
        for path, change in outcome.changes.items():
            yield outcome, path, change, "", True
        for finding in outcome.findings:
            base = None if finding.rule.absolute else finding.base
            # The shown number is the bound that decides the verdict.
            first = (finding.verdict is Verdict.FAIL) is not finding.rule.is_minimum
            now = finding.now.lower if first else finding.now.upper
            values = (base, finding.limit, now)
            yield outcome, finding.rule.text, values, shown_verdict(finding), finding.now.proven
        if outcome.verdict is Verdict.NEW:
            total = outcome.values["total"].upper
            yield outcome, outcome.verdict, (None, None, total), "new", True
        elif not outcome.findings and outcome.verdict not in (Verdict.UPDATED, Verdict.PASS):
            yield outcome, "", (None,) * len(LIMITS), outcome.verdict, True


def table(report: Report, width: int = table_text.WIDTH) -> str:
    """Return a table of the rules of all pairs, and notes.

    With more than `MANY_ROWS` rows, rules that pass are left out. For an update with so many rows,
    only totals are shown.
    """
    updated = report.verdict is Verdict.UPDATED
    all_rows = list(rows_of(report))
    shown = all_rows
    if len(all_rows) > MANY_ROWS:
        shown = [row for row in all_rows if (row[1] == "total" if updated else row[3] not in QUIET)]
        shown.sort(key=worst_first)
    rules = max([WIDTHS[1], *(len(visible(row[1])) + 3 for row in shown)])
    rules = min(rules, max(WIDTHS[1], width // 3))
    names = width - sum(WIDTHS[2:5]) - len(" undecided") - rules
    titles = {id(one): visible(title(one)) for one in report.outcomes}
    short = dict(zip(titles.values(), shortened([*titles.values()], names - 1), strict=False))
    widths = (max([WIDTHS[0], *(len(text) + 1 for text in short.values())]), rules, *WIDTHS[2:])
    rows: list[table_text.Row] = []
    above = None
    for outcome, rule, values, verdict, proven in shown:
        pair = "" if outcome is above else short[titles[id(outcome)]]
        text = ending(visible(f"{rule or verdict}{'' if proven else ' *'}"), rules - 1)
        numbers_of = map(number_of, values) if rule else ()
        rows.append((pair, text, *numbers_of, *([f" {verdict}"] if rule and not updated else [])))
        above = outcome
    head = ("pair", "value", "old", "new") if updated else ("pair", "rule", *LIMITS)
    lines = table_text.text_lines(
        table_text.Table(head=head, rows=rows, align="llrrrl", widths=widths), ""
    )
    if len(all_rows) > len(shown):
        lines.append(f"... and {len(all_rows) - len(shown)} {'values' if updated else 'that pass'}")
    if any(not finding.now.proven for o in report.outcomes for finding in o.findings):
        lines += ["", f"* {UNPROVEN}"]
    lay = TextWrapper(width, "", "  ", break_on_hyphens=False, break_long_words=False)
    notes = [line for text in notes_of(report.outcomes) for line in lay.wrap(visible(text))]
    blocks = [lay.wrap(headline(report)), lines if len(lines) > 1 else [], notes]
    blocks += [lay.wrap(visible(text)) for text in report.messages() if text not in report.warnings]
    if report.advice:
        title_of = lay.wrap(visible(f"{accept_title(report)}:"))
        blocks.append([*title_of, f"  {visible(report.advice)}"])
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


MANY_ROWS = 40
"""Number of rows above which rules that pass are not shown one by one."""


def notes_of(outcomes: Iterable[PairOutcome]) -> Iterator[str]:
    """Yield the notes on pairs, each sentence once, with the names of its pairs.

    Notes of errors are left out, because the command prints them to stderr. Some reports, such as
    Markdown, are read without stderr. They add the notes of errors.
    """
    titles: dict[str, list[str]] = {}
    for outcome in sorted(outcomes, key=lambda one: SEVERITY.index(ExitStatus(one.status))):
        for note in outcome.notes if outcome.verdict is not Verdict.ERROR else ():
            titles.setdefault(note, []).append(title(outcome))
    for note, names in titles.items():
        yield f"{listed(names, SAID_OF)}: {note}"


SAID_OF = 3
"""Largest number of pairs that a note names."""


def shortened(names: Sequence[str], width: int) -> list[str]:
    """Shorten names to `width` characters; different names stay different if possible."""
    if max(map(len, names), default=0) <= width:
        return [*names]
    parts = [name.split("/") for name in names]
    first = _common(parts)
    last = _common([part[first:][::-1] for part in parts])
    inner = ["/".join(part[first : len(part) - last]) for part in parts]
    if first == last == 0 or max(map(len, inner)) + 6 > width:
        # Names can also share a part of the text between slashes, as run-01-of-the-suite and
        # run-02-of-the-suite do.
        first = len(_prefix(names))
        last = len(_prefix([name[first:][::-1] for name in names]))
        inner = [name[first : len(name) - last] for name in names]
        if max(map(len, inner)) + 6 > width:
            first, last, inner = 0, 0, [*names]
    dots = "..." if first else "", "..." if last else ""
    room = width - sum(map(len, dots))
    return [
        f"{dots[0]}{text}{dots[1]}"
        if len(text) <= room
        else f"{text[: room // 2 - 3]}...{text[len(text) - (width - room // 2) :]}"
        for text in inner
    ]


def _prefix(names: Sequence[str]) -> str:
    """Return the common prefix that leaves at least one character of each name."""
    return min(names)[: _common(names)]


def _common(parts: Sequence[Sequence[str]]) -> int:
    """Return the number of leading parts that all names share; the last part never counts."""
    same = takewhile(lambda column: len({*column}) == 1, zip(*parts, strict=False))
    return min(sum(1 for _ in same), min(map(len, parts)) - 1)


def accept_title(report: Report) -> str:
    """Return the title of the command that accepts the new values."""
    until = f"; {report.against} judges until it has them" if report.against else ""
    return f"To accept the new values, if they are right{until}"


IN_NOISE = "in noise"
"""Verdict on a group above its limit, if the choice of random seeds can explain the excess."""

QUIET = (Verdict.PASS, IN_NOISE)


def in_words(verdict: Verdict) -> str:
    """Return a verdict as reports show it."""
    return IN_NOISE if verdict is Verdict.NOISE else verdict


def shown_verdict(finding: Finding) -> str:
    """Return the verdict that reports show; "warning" if a rule that only warns does not pass."""
    return "warning" if finding.warning else in_words(finding.verdict)


def number_of(value: float | None) -> str:
    """Format a number for its column; an unknown number is a dash."""
    if value is None or math.isnan(value):
        return "-"
    text = number(value, 7)
    return text if len(text) < WIDTHS[2] else f"{value:.4g}"


def json_report(report: Report) -> str:
    """Return the report as JSON with sorted keys, without NaN or Infinity."""
    document = {
        "schema": SCHEMA,
        "version": report.version,
        "baseline": report.baseline,
        "verdict": report.verdict,
        "status": report.status,
        "update": report.advice,
        **({"against": report.against} if report.against else {}),
        **settings_field(report.settings_file),
        "notices": list(report.notices),
        "groups": [_pair(outcome) for outcome in report.outcomes if outcome.group],
        "pairs": [_pair(outcome) for outcome in report.outcomes if not outcome.group],
    }
    return json_text(document)


OF_THE_OUTCOME = ("name", "truth", "estimate", "verdict", "status", "seconds")
"""Fields of an outcome that the JSON has unchanged."""


def _pair(outcome: PairOutcome) -> Json:
    return {
        **{name: getattr(outcome, name) for name in OF_THE_OUTCOME},
        "notes": list(outcome.notes),
        "warnings": [notice.record() for notice in outcome.warnings],
        "rules": [finding_record(finding) for finding in outcome.findings],
        "changes": {path: {"old": old, "new": new} for path, (old, new) in outcome.changes.items()},
    }


def finding_record(finding: Finding) -> Json:
    """Return a finding as a record of the JSON."""
    return {
        "rule": finding.rule.text,
        "warns": finding.rule.warns,
        "path": finding.rule.path,
        "baseline": None if finding.rule.absolute else finding.base,
        "limit": _finite(finding.limit),
        "lower": _finite(finding.now.lower),
        "upper": _finite(finding.now.upper),
        "proven": finding.proven,
        "improved": finding.improved,
        "verdict": finding.verdict,
        **({"inference": _inference(finding.inference)} if finding.inference else {}),
    }


def _inference(inference: Inference) -> Json:
    record = vars(inference) | {"noticeable": _finite(inference.noticeable)}
    return {name: value for name, value in record.items() if name != "better"}


def _finite(value: float) -> float | None:
    """Return the number; None if JSON cannot express it."""
    return value if math.isfinite(value) else None


def markdown(report: Report) -> str:
    """Return the Markdown report, short enough for a comment on a pull request."""
    return summary(report, COMMENT).decode()


def github_lines(report: Report) -> Iterator[str]:
    """Yield the Markdown report: verdict, failed rules and reasons, other rules, passed rules."""
    yield from (f"**TGOSPA {headline(report)}**", "")
    updated = report.verdict is Verdict.UPDATED
    bad, quiet = (
        [one for one in report.outcomes if bool(one.status) is is_bad] for is_bad in (True, False)
    )
    rows: dict[bool | None, list[table_text.Row]] = {True: [], None: [], False: []}
    for outcome, rule, values, verdict, proven in sorted(rows_of(report), key=worst_first):
        passes = verdict in QUIET
        about = verdict if rule and passes else f"**{verdict}**"
        about += "" if proven else ", split, not proven"
        numbers = [_cell(value) for value in values] if rule else [None] * len(LIMITS)
        text = table_text.markdown_code(rule) if rule else None
        end = [] if updated else [change(values), about]
        fails = None if verdict not in (*FIRST, Verdict.PASS) else not passes
        rows[fails].append((table_text.markdown_code(title(outcome)), text, *numbers, *end))
    head = ("value", "old", "new") if updated else ("rule", *LIMITS, "change", "verdict")
    align = "llrr" if updated else "llrrrrl"
    fold, later = len(rows[False]) > FOLDED, len(rows[None]) > MANY_ROWS
    first = rows[True] + ([] if later else rows[None]) + ([] if fold else rows[False])

    def lines_of(rows: Sequence[table_text.Row]) -> list[str]:
        return table_text.markdown_lines(
            table_text.Table(head=("pair", *head), rows=rows, align=align), escape=str
        )

    yield from (*lines_of(first), "") if first else ()
    for some in (bad, quiet):
        for outcome in some:
            for note in outcome.notes if outcome.verdict is Verdict.ERROR else ():
                yield f"- {table_text.markdown_code(title(outcome))}: {table_text.markdown(note)}"
        yield from (f"- {table_text.markdown(text)}" for text in notes_of(some))
        for outcome in some:
            for warning in map(str, outcome.warnings):
                name = table_text.markdown_code(title(outcome))
                yield f"- {name}: {table_text.markdown(warning)}"
        if some is bad:
            yield from (f"- {table_text.markdown(text)}" for text in report.messages())
            yield from advice_lines(report)
            yield from ("", *lines_of(rows[None]), "") if later else ()
    if fold:
        yield f"\n<details><summary>{len(rows[False])} rules that pass</summary>\n"
        yield from (*lines_of(rows[False]), "", "</details>")


def advice_lines(report: Report) -> list[str]:
    """Return the lines of Markdown with the command that accepts the new values."""
    if not report.advice:
        return []
    return [
        f"\n{table_text.markdown(accept_title(report))}: {table_text.markdown_code(report.advice)}",
        "",
    ]


FOLDED = 5
"""Largest number of passing rules that Markdown shows without folding them."""


def change(values: tuple[float | None, ...]) -> str | None:
    """Return the change from the baseline to the new value, in per cent."""
    base, now = values[0], values[-1]
    return f"{now / base - 1:+.1%}" if base and now is not None else None


def _cell(value: float | None) -> str:
    return "" if value is None or math.isnan(value) else number(value, 7)


GATE_REPORTS = {
    "table": table,
    "json": json_report,
    "markdown": markdown,
}
"""Reports of the gate, by the name of ``--format``."""


# -------------------------------------------------------------------------------------------------
# Report for GitHub Actions: annotations and the step summary, within GitHub's limits.
#
# GitHub shows ten errors and ten warnings of a step, and a summary of at most 1 MiB.

MAX_ANNOTATIONS = 10
"""Largest number of annotations of one kind that GitHub shows for a step."""

LONGEST = 1000
"""Largest number of characters of a message."""

SUMMARY = 1_000_000
"""Largest number of bytes of the step summary."""

COMMENT = 60_000
"""Largest number of bytes of a comment on a pull request; GitHub allows 65,536 characters."""

TRUNCATED = "\n*The rest does not fit in here; see the log or the JUnit report.*\n"


def annotations(report: Report) -> Iterator[str]:
    """Yield commands of GitHub: an error for each pair that does not pass, and all warnings."""
    errors = [
        (title(outcome), "\n".join((outcome.verdict, *outcome.notes)))
        for outcome in report.outcomes
        if outcome.status
    ]
    warnings = [("all pairs", text.removeprefix("warning: ")) for text in report.warnings]
    for outcome in report.outcomes:
        lines = [notice.sentence for notice in outcome.warnings]
        if outcome.warned:
            broken = ", ".join(finding.rule.text for finding in outcome.warned)
            lines.insert(0, f"broken or undecided, for a warning only: {broken}")
        if lines:
            warnings.append((title(outcome), "\n".join(lines)))
    for kind, entries in (("error", errors), ("warning", warnings)):
        shown = entries if len(entries) <= MAX_ANNOTATIONS else entries[: MAX_ANNOTATIONS - 1]
        for name, text in shown:
            yield _command(kind, f"TGOSPA gate: {name}", text)
        if len(entries) > len(shown):
            rest = entries[len(shown) :]
            names = ", ".join(name for name, _ in rest)
            yield _command(kind, f"TGOSPA gate: {len(rest)} more pairs", names)


def _command(kind: str, heading: str, text: str) -> str:
    message = "\n".join(map(visible, text.split("\n")))
    if len(message) > LONGEST:
        message = message[: LONGEST - 3] + "..."
    heading = table_text.workflow_property(clipped(heading, LONGEST))
    return f"::{kind} title={heading}::{table_text.workflow_data(message)}"


def append_summary(report: Report, path: str | None) -> None:
    """Append the Markdown report to the step summary, as many whole lines as fit.

    Without a path, as outside of GitHub Actions, nothing is written.

    Raises
    ------
    ConfigError
        The system refuses to write the file.
    """
    if not path:
        return
    with named(f"{option('github')}: {path}", ConfigError, "cannot be written"):
        used = 0 if is_missing(path) else os.stat(path).st_size
        with patience(path, "a reader of"), open(path, "ab") as file:
            file.write(summary(report, SUMMARY - used))


def summary(report: Report, room: int) -> bytes:
    """Return the Markdown report in at most `room` bytes."""
    lines = [f"{line}\n".encode() for line in (*github_lines(report), "")]
    if sum(map(len, lines)) <= room:
        return b"".join(lines)
    # The command that accepts the values is kept if it takes at most half of the room.
    advice = "".join(f"{line}\n" for line in advice_lines(report)).encode()
    advice = b"" if 2 * len(advice) > room else advice
    room -= len(TRUNCATED.encode()) + len(END) + len(advice)
    shown: list[bytes] = []
    for line in lines:
        room -= len(line)
        if room < 0:
            break
        shown.append(line)
    end = END if any(line.startswith(b"\n<details>") for line in shown) else b""
    if not shown:
        return b""
    text = b"".join((*shown, end))
    return b"".join((text, b"" if advice in text else advice, TRUNCATED.encode()))


END = b"\n</details>\n"


# -------------------------------------------------------------------------------------------------
# Report as JUnit XML in the form that Jenkins and GitLab read, with one case for each rule.
#
# A broken rule is a failure. A rule that could not be judged is an error. If a broken rule only
# warns, its case counts as passed and has a text. No library for XML is used, because its import
# takes as long as a small evaluation.

SUITE = "tgospa-eval gate"
PAGE = "gate.html"
"""Name of the page of all pairs, in the folder of ``-o``."""


def junit(report: Report, folder: str | None = None) -> str:
    """Return the report as an XML document.

    If a finding of an outcome does not pass, the first case of the outcome has an attachment. It
    names a page in `folder`: the page of the outcome if there is one, else the page of all pairs.
    """
    cases: list[str] = []
    for outcome in report.outcomes:
        messages = report.messages(*outcome.warnings)
        if folder and any(one.verdict is not Verdict.PASS for one in outcome.findings):
            messages.append(f"[[ATTACHMENT|{os.path.join(folder, outcome.page_name or PAGE)}]]")
        cases += _cases(outcome, messages)
    attributes = {
        "name": SUITE,
        "tests": str(len(cases)),
        "failures": str(sum("<failure " in case for case in cases)),
        "errors": str(sum("<error " in case for case in cases)),
        "time": f"{sum(outcome.seconds for outcome in report.outcomes):.3f}",
    }
    return "".join(
        (
            '<?xml version="1.0" encoding="UTF-8"?>\n',
            f"<testsuites{_attributes(attributes)}>\n",
            f" <testsuite{_attributes(attributes | {'skipped': '0'})}>\n",
            *cases,
            " </testsuite>\n</testsuites>\n",
        )
    )


def _cases(outcome: PairOutcome, messages: list[str]) -> Iterator[str]:
    """Yield a case for each rule, or one case if there are no rules.

    The first case has the time and the messages.
    """
    text = "\n".join(outcome.notes)
    if not outcome.findings:
        kind = "failure" if outcome.verdict is Verdict.FAIL else "error"
        result = _result(kind, outcome.verdict, text) if outcome.status else ""
        yield _case(outcome, "gate", outcome.seconds, result + _output(messages))
    for place, finding in enumerate(outcome.findings):
        verdict = shown_verdict(finding)
        mark = "" if finding.now.proven else " (split, not proven)"
        words = "at least " if finding.rule.is_minimum else ""
        lower, upper, limit = texts(finding.now.lower, finding.now.upper, finding.limit)
        value = lower if lower == upper else f"between {lower} and {upper}"
        about = f"{finding.rule.path} is {value}, allowed is {words}{limit}{mark}"
        if finding.verdict is Verdict.INCOMPARABLE:
            about = f"there is no {finding.rule.path}"
        result, lines = "", [] if place else messages
        if finding.warning or verdict == IN_NOISE:
            lines = [f"{verdict}: {about}", *lines]
        elif verdict == Verdict.FAIL:
            result = _result("failure", verdict, text, about)
        elif verdict != Verdict.PASS:
            result = _result("error", verdict, text, about)
        seconds = 0.0 if place else outcome.seconds
        # The name is without the limit, so that a case keeps its history when the limit changes.
        rule = finding.rule
        kind = (
            (" min" if rule.is_minimum else " max") if rule.absolute else " less" * rule.is_minimum
        )
        kind += " warning" * rule.warns
        name = f"{rule.text}: {finding.run}" if finding.run else rule.path + kind
        yield _case(outcome, name, seconds, result + _output(lines))


def _case(outcome: PairOutcome, name: str, seconds: float, result: str) -> str:
    about = {"classname": title(outcome), "name": name, "time": f"{seconds:.3f}"}
    inner = f">\n   {result}\n  </testcase>\n" if result else " />\n"
    return f"  <testcase{_attributes(about)}{inner}"


def _result(kind: str, verdict: str, text: str, message: str = "") -> str:
    about = {"type": verdict, "message": message or text.partition("\n")[0]}
    return f"<{kind}{_attributes(about)}>{table_text.xml(text)}</{kind}>"


def _output(lines: Iterable[str]) -> str:
    text = "\n".join(lines)
    return f"<system-out>{table_text.xml(text)}</system-out>" if text else ""


def _attributes(values: dict[str, str]) -> str:
    return "".join(f' {name}="{table_text.xml(value)}"' for name, value in values.items())


# -------------------------------------------------------------------------------------------------
# Folder of a gate: a page with verdicts and changes, and the pages of pairs.

LEVELS = (0.01, 0.03, 0.1, 0.3)
"""Relative changes at which a cell of the page becomes darker."""


def gate_files(report: Report, seed: str = SEED) -> dict[str, str]:
    """Return the contents of the files of the folder, by their names.

    Parameters
    ----------
    report : Report
        Report of the gate.
    seed : str
        Name of the label with the random seed. Runs that differ only in this label are one scene.
    """
    pages = {one.page_name: one.page for one in report.outcomes if one.page}
    return {
        "gate.json": json_report(report),
        "gate.md": markdown(report),
        PAGE: page(report, seed),
        **pages,
    }


def page(report: Report, seed: str) -> str:
    """Return the page of all pairs, made from a template, without a script."""
    from tgospa_eval.show.html import images, still_page  # lazy: needed only to write a folder

    rows = [
        {
            "name": title(outcome),
            "link": _link(outcome),
            "rule": rule,
            "numbers": [*map(number_of, values), change(values) or ""] if rule else [""] * 4,
            "verdict": verdict + ("" if proven else ", split, not proven"),
            "passes": verdict in QUIET,
        }
        for outcome, rule, values, verdict, proven in sorted(rows_of(report), key=worst_first)
    ]
    seeds, grid = _grid(report, seed)
    totals = _totals(report, seed)
    return still_page(
        "gate.html.j2",
        report=report,
        headline=headline(report),
        accept_title=accept_title(report),
        beside=report.messages(
            *(w.about(title(one)) for one in report.outcomes for w in one.warnings)
        ),
        failing=[row for row in rows if not row["passes"]],
        passing=[row for row in rows if row["passes"]],
        notes=list(notes_of(report.outcomes)),
        chart="".join(images("page of a gate", totals, draws=bool(totals)).values()),
        seeds=seeds,
        grid=grid,
    )


def _link(outcome: PairOutcome) -> str:
    return quote(outcome.page_name)


def _grid(report: Report, seed: str) -> tuple[list[str], list[tuple[str, list[Json]]]]:
    """Return all seeds, and for each scene its name with a cell for each seed.

    Only pairs that were evaluated count.
    """
    scenes: dict[str, dict[str, PairOutcome]] = {}
    for one in report.outcomes:
        if one.values and not one.group:
            scene = "/".join(text for label, text in one.labels.items() if label != seed)
            scenes.setdefault(scene if seed in one.labels else one.name, {})[
                one.labels.get(seed, "")
            ] = one
    seeds = sorted({name for runs in scenes.values() for name in runs}, key=natural)
    return seeds, [
        (scene, [_grid_cell(runs.get(name)) for name in seeds])
        for scene, runs in sorted(scenes.items(), key=lambda item: natural(item[0]))
    ]


def _totals(report: Report, seed: str) -> dict[str, tuple[list[float], list[float]]]:
    """Return the totals of the runs of the baseline and of the new runs, by scene."""
    totals: dict[str, tuple[list[float], list[float]]] = {}
    for one in report.outcomes:
        if one.values and one.base and seed in one.labels:
            scene = "/".join(text for label, text in one.labels.items() if label != seed)
            old, now = totals.setdefault(scene or "all runs", ([], []))
            old.append(one.base)
            now.append(one.values["total"].upper)
    return totals


def _grid_cell(one: PairOutcome | None) -> Json:
    if one is None:
        return {"text": "", "level": "", "link": ""}
    ends = one.base, one.values["total"].upper
    share = ends[1] / ends[0] - 1 if ends[0] else 0.0
    level = sum(abs(share) >= threshold for threshold in LEVELS)
    kind = "worse" if share > 0 else "better"
    return {
        "text": change(ends) or "-",
        "level": f"{kind}{level}" if level else "",
        "link": _link(one),
    }
