"""The verbs of the command line, each imported when it is used, and the group that chooses one."""

from importlib import import_module
from typing import TYPE_CHECKING

import click

from tgospa_eval._version import __version__

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


VERBS = {
    "evaluate": ("evaluate", "Evaluate an estimate; the verb if none is given."),
    "inspect": ("inspect", "Show what is in the files, and what looks wrong."),
    "explain": ("explain", "Show which single repairs would save most, with proof."),
    "gate": ("gate", "Fail a CI job if the estimate got worse."),
    "compare": ("compare", "Rank several estimates, or compare solvers."),
    "batch": ("batch", "Evaluate a whole benchmark or study."),
    "verify": ("verify", "Check the proof of a value, in exact integers."),
    "simulate": ("simulate", "Make a ground truth and an estimate to try it on."),
    "associate": ("associate", "Associate the states of two sensors."),
    "reduce": ("reduce", "Reduce particle clouds to fewer particles."),
}
"""For each verb, its module and a summary. The module has the function `command`."""

SECTION = "tgospa_eval.section"
"""Key of the click context for the section that ``help VERB SECTION`` shows."""

CONFIG = "tgospa_eval.common.config"
"""Key of the click context for the configuration file in use."""


def load(verb: str) -> click.Command:
    """Import a verb, and return its command."""
    command: click.Command = import_module(f"tgospa_eval.cli.{VERBS[verb][0]}").command
    return command


VERB_WORDS = {
    "evaluate": "eval score metric measure compute calculate run plot draw report sweep curve",
    "explain": "why repair repairs fix improve cause causes reason",
    "gate": "check test baseline regression assert ci",
    "inspect": "info show view look head describe summary summarise validate lint stats",
    "compare": "rank ranking diff versus vs bench benchmark study",
    "associate": "match assign pair fuse",
    "reduce": "downsample resample compress shrink",
    "batch": "many all folder folders benchmark nightly sequences runs",
    "verify": "proof prove certificate certify audit recheck",
    "simulate": "sim generate gen make create demo synth example",
}
"""For each verb, other words that people type for it."""

LIKE_A_VERB = r"[A-Za-z][A-Za-z_-]+"


class Verbs(click.Group):
    """Group of the verbs. Options can stand before the verb; without a verb it is ``evaluate``."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the verbs."""
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import a verb, and return its command; None for any other word."""
        return load(cmd_name) if cmd_name in VERBS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the names and summaries of the verbs to the help, without importing them."""
        with formatter.section("Verbs"):
            formatter.write_dl([(name, summary) for name, (_, summary) in VERBS.items()])

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the verb before all options, and replace the word ``help`` by ``--help``.

        Raises
        ------
        click.UsageError
            The first argument is neither a verb nor a file, but is similar to a verb. Or the word
            after ``help`` is not a verb.
        """
        if args[:1] == ["help"]:
            verb, section = args[1:2], args[2:]
            if verb and verb[0] not in VERBS:
                _check_word(ctx, verb[0])
                raise click.UsageError(f"no verb {verb[0]}; there are {', '.join(VERBS)}", ctx)
            if section:
                ctx.meta[SECTION] = " ".join(section)
                args = args[:2]
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

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        """Return completions of the first word: a verb, a file or an option of ``evaluate``."""
        from click.shell_completion import CompletionItem  # lazy: few runs are completions

        if incomplete.startswith("-"):
            evaluate = self.get_command(ctx, "evaluate")
            completions = super().shell_complete(ctx, incomplete)
            return [*completions, *(evaluate.shell_complete(ctx, incomplete) if evaluate else ())]
        verbs = [
            CompletionItem(name, help=about)
            for name, (_, about) in VERBS.items()
            if name.startswith(incomplete)
        ]
        if not verbs:
            return [CompletionItem(incomplete, type="file")]
        return [*verbs, *map(CompletionItem, _files_like(incomplete))]

    def _first_argument(self, ctx: click.Context, args: list[str]) -> int | None:
        """Return the index of the first argument that is neither an option nor its value."""
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
                # Letters can be joined, as in -qc5. The first one that needs a value (c) takes the
                # rest (5) as value. If there is no rest, the next argument is the value.
                value = next((k for k, c in enumerate(text) if k and f"-{c}" in taking), None)
                skip = value == len(text) - 1
            else:
                return at
        return None


def _files_like(begin: str) -> list[str]:
    """Return the names of files in the current folder that begin with a text.

    These names are shown together with verbs. Names with blanks are left out, because the shell
    would split them. If no verb begins with the text, the shell completes names of files itself.
    """
    import os  # lazy: few runs are completions

    try:
        with os.scandir() as entries:
            names = [entry.name + os.sep * entry.is_dir() for entry in entries]
    except OSError:
        return []
    plain = (name for name in names if name.isprintable() and not set(name) & set(" \"'\\"))
    return sorted(name for name in plain if name.startswith(begin) and not name.startswith("."))


def _check_word(ctx: click.Context, word: str) -> None:
    """Check that a word is not a verb with a typing error.

    Raises
    ------
    click.UsageError
        No file has this name, and a verb is similar to it.
    """
    import os  # lazy: not needed if the word is a verb
    import re

    if not re.fullmatch(LIKE_A_VERB, word) or os.path.lexists(word):
        return
    from difflib import get_close_matches  # lazy: only for words that are not files

    plain = word.lower()
    verbs = [verb for verb, words in VERB_WORDS.items() if plain in words.split()]
    for verb in (verbs or get_close_matches(plain, VERB_WORDS, 1, 0.8))[:1]:
        raise click.UsageError(f"{word}: not a verb or a file; did you mean {verb}?", ctx)


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
      tgospa-eval evaluate -h              the options that are used most
      tgospa-eval help evaluate            all of them; help evaluate metric: a section
    """
