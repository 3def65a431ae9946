"""The command line: a group of verbs, each imported when it is asked for."""

import atexit
import gc
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

import click

from tgospa_eval import __version__
from tgospa_eval.common import files
from tgospa_eval.cli.guard import guarded
from tgospa_eval.cli.shared.interrupts import heard
from tgospa_eval.cli.shared.streams import check_stdout, check_written, say, say_lines
from tgospa_eval.errors import ConfigError, TgospaError

VERBS = {
    "evaluate": ("tgospa_eval.cli.evaluate.command", "Evaluate an estimate; the verb if none is given."),
    "inspect": ("tgospa_eval.cli.inspect", "Show what is in the files, and what looks wrong."),
    "gate": ("tgospa_eval.cli.gate.command", "Fail a CI job if the estimate got worse."),
    "compare": ("tgospa_eval.cli.compare.command", "Rank several estimates, or compare solvers."),
    "simulate": ("tgospa_eval.cli.simulate.command", "Make a ground truth and an estimate to try it on."),
    "associate": ("tgospa_eval.cli.sensors.associate", "Associate the states of two sensors."),
    "reduce": ("tgospa_eval.cli.sensors.reduce", "Reduce particle clouds to fewer particles."),
}
"""Module and summary of each verb; the module's command is called `command`."""

INTERRUPTED = 130
NO_MEMORY = (
    "annot allocate memory", "failed to map segment", "bad_alloc", "start new thread",
    "without exception set",
)  # fmt: skip
"""What systems, loaders of libraries and Python say where there is none left."""

INTERNAL = 4
"""Of faults of ours, as of solvers: neither passed nor failed, nothing is known."""

CONFIG = "tgospa_eval.common.config"
"""Under this name the context keeps the configuration file in use."""


def load(verb: str) -> click.Command:
    """Import a verb."""
    command: click.Command = import_module(VERBS[verb][0]).command
    return command


class Verbs(click.Group):
    """Finds the verb wherever it stands among the options; without one it is ``evaluate``."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names of the verbs."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a verb."""
        return load(cmd_name) if cmd_name in VERBS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the summaries, without importing the verbs."""
        with formatter.section("Verbs"):
            formatter.write_dl([(name, summary) for name, (_, summary) in VERBS.items()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the verb first; `help` is --help.

        Raises
        ------
        click.UsageError
            The first argument is neither a verb nor a file, but like a verb.
        """
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        if args and args[0] not in ("--help", "-h", "--version"):
            at = self._first_argument(ctx, args)
            if at is not None and args[at] in VERBS:
                args = [args[at], *args[:at], *args[at + 1 :]]
            else:
                if at is not None:
                    _check_word(ctx, args[at])
                args = ["evaluate", *args]
        return super().parse_args(ctx, args)

    def _first_argument(self, ctx: click.Context, args: list[str]) -> int | None:
        """Position of the first argument that is neither an option nor the value of one."""
        if not args[0].startswith("-"):
            return 0
        commands = [self.get_command(ctx, verb) for verb in ("evaluate", "gate")]
        taking = {
            name
            for command in commands
            for option in (command.params if command else ())
            if isinstance(option, click.Option) and not (option.is_flag or option.count)
            for name in option.opts
        }
        skip = False
        for at, text in enumerate(args):
            if skip:
                skip = False
            elif text == "--":
                return None
            elif text.startswith("--"):
                skip = text in taking
            elif text.startswith("-") and len(text) > 1:
                # Of letters run together the first that takes a value takes the rest, if any.
                value = next((k for k, c in enumerate(text) if k and f"-{c}" in taking), None)
                skip = value == len(text) - 1
            else:
                return at
        return None


def _check_word(ctx: click.Context, word: str) -> None:
    """Whether a word may be the name of a file.

    Raises
    ------
    click.UsageError
        It is more like a verb.
    """
    from tgospa_eval.cli.shared.help import meant_verb  # here: not needed where a verb is given

    verb = meant_verb(word)
    if verb is not None:
        raise click.UsageError(f"{word}: neither a verb nor a file; did you mean {verb}?", ctx)


@click.group(
    cls=Verbs,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80},
    subcommand_metavar="[VERB] TRUTH ESTIMATE [OPTIONS]",
    options_metavar="",
    no_args_is_help=True,
)
@click.version_option(__version__, prog_name="tgospa-eval", message="%(prog)s %(version)s")
def cli() -> None:  # \b keeps click from filling the lines below it
    """Evaluate a multi-target tracker with the TGOSPA metric, exactly and with proof.

    TRUTH and ESTIMATE are tables with the columns id,t,x[,y[,z]] and one row per
    object and time step (CSV or Parquet), or MOTChallenge or KITTI text.

    \b
    Examples:
      tgospa-eval simulate demo            make two files to try it on
      tgospa-eval demo/truth.csv demo/estimate.csv
                                           evaluate them
      tgospa-eval help evaluate            all options, with examples
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with the status of docs/reference/cli.md."""
    # Memory goes with the process: to look through all modules for cycles first takes as long as
    # a small evaluation.
    atexit.register(gc.freeze)
    files.announce = say

    def work() -> int:
        try:
            return _run(arguments)
        except Exception as error:
            _say_internal(error)
            return INTERNAL

    sys.exit(guarded(work, INTERRUPTED) if arguments is None else work())


def _run(arguments: Sequence[str] | None) -> int:
    """Run the command line; the exit status."""
    status: int | None
    try:
        status = _invoke(None if arguments is None else list(arguments))
        if heard():  # what was left behind in compiled code is not waited for
            _end_interrupted()
    except SystemExit:  # click's own, with 1, where a pipe has no reader
        status = 0
    except TgospaError as error:
        say_lines(str(error))
        status = error.exit_status
    except click.ClickException as error:
        context = getattr(error, "ctx", None)
        if context is not None and context.meta.get(CONFIG):
            say(f"settings from {context.meta[CONFIG]}")
        text = io.StringIO()
        error.show(file=text)
        say_lines(text.getvalue().rstrip("\n"))
        status = max(error.exit_code, 2)  # 1 is a regression, and nothing else
    except (KeyboardInterrupt, click.Abort):
        say("interrupted")
        _end_interrupted()  # a solver may be deep in compiled code, in its own thread
    except (OSError, MemoryError, ImportError, RuntimeError, SystemError) as error:
        status = _say_lacking(error)
    return status or 0


def _say_lacking(error: Exception) -> int:
    """What the system does not give is no fault of ours, even if unforeseen; the status."""
    if _is_of_memory(error):
        say("out of memory; a smaller cutoff leaves fewer pairs")
        return INTERNAL
    if not isinstance(error, OSError):
        raise error
    where = "" if error.filename is None else f"{error.filename}: "
    say(f"{where}{files.reason(error)}")
    return ConfigError.exit_status


def _is_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or one behind it, is for want of memory, as libraries need some as well."""
    while error is not None:
        if isinstance(error, MemoryError) or any(text in str(error) for text in NO_MEMORY):
            return True
        error = error.__cause__ or error.__context__
    return False


def _end_interrupted() -> None:
    """End at once, with what was printed."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(INTERRUPTED)


def _invoke(arguments: list[str] | None) -> int | None:
    """Run the command line, seeing to it that what it prints arrives."""
    if sys.stderr is None:  # or the next file that is opened is taken for it
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    check_stdout()
    try:
        status: int | None = cli.main(
            args=arguments, prog_name="tgospa-eval", standalone_mode=False
        )
    except OSError as error:  # of the help, which click prints
        check_written(error)
        raise
    return status


def _say_internal(error: Exception) -> None:
    """The traceback of a fault of ours, and a sentence."""
    import traceback  # here: there should be none

    say_lines("".join(traceback.format_exception(error)).rstrip("\n"))
    say(f"internal error: {type(error).__name__}: {error}; please report it")
