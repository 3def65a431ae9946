"""From the options of `explain` to repairs, printed, and a repaired file."""

from pathlib import Path

from tgospa_eval.api.request import Request, Values
from tgospa_eval.cli.evaluate.run import evaluate_files, explained
from tgospa_eval.cli.shared.streams import emit, print_notice
from tgospa_eval.cli.shared.values import OutputOptions
from tgospa_eval.cli.shared.writing import check_apart
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError
from tgospa_eval.formats.write import TABLES
from tgospa_eval.reports.explanation import render
from tgospa_eval.reports.files import check_file, write_file
from tgospa_eval.results.explanation import Explanation


@dataclass(frozen=True, kw_only=True)
class ExplainOptions(Values):
    """Those that only this verb has."""

    top: int = 10
    apply: int = 1
    output: str | None = None
    force: bool = False


def explain_files(
    paths: tuple[str, str],
    options: Request,
    output: OutputOptions,
    wanted: ExplainOptions,
) -> bool:
    """Evaluate, explain, print and write; whether the asked accuracy was reached.

    Raises
    ------
    TgospaError
        Something is wrong with options or files, or there is no such repair to write.
    """
    if wanted.output is not None:
        _check(wanted.output, paths, force=wanted.force)
    result, finished = evaluate_files(*paths, options, output)
    explanation = explained(result, options, output, max(wanted.top, wanted.apply))
    if wanted.output is not None:
        _write(explanation, wanted, output)
    emit(render(explanation, output.format_), output.format_)
    return finished


def _check(path: str, paths: tuple[str, str], *, force: bool) -> None:
    """Whether the repaired file may be written.

    Raises
    ------
    ConfigError
        It may not.
    """
    check_file(path, force=force, option="-o")
    check_apart(path, list(paths), "-o")
    if Path(path).suffix.casefold() not in TABLES:
        raise ConfigError(f"-o {path}: must end in {', '.join(TABLES)}")


def _write(explanation: Explanation, wanted: ExplainOptions, output: OutputOptions) -> None:
    path = str(wanted.output)
    try:
        repaired = explanation.repaired(wanted.apply)
    except ConfigError as error:
        raise ConfigError(f"--apply {wanted.apply}: {error}; nothing is written") from None
    write_file(path, TABLES[Path(path).suffix.casefold()](repaired), "-o")
    if not output.quiet:
        text = explanation.repairs[wanted.apply - 1].text
        print_notice(f"wrote {path}: the estimate with repair {wanted.apply}, {text}")
