"""Classes of verbs and options for click: values from settings files, help, and messages."""

import os
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tgospa_eval.api.options import PLAIN, SOLVERS
from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.verbs import CONFIG, SECTION, VERBS, load
from tgospa_eval.common import config
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.registry import Registry
from tgospa_eval.quoting import clipped, listed, visible

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem
    from click.types import OptionHelpExtra

    from tgospa_eval.campaign.gate.suite import Target

PATH = click.Path(readable=False)


class SourceFile(click.Path):
    """Type for a file to read. ``-`` is the standard input, for at most one argument."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path, or the name of the standard input."""
        if value != "-":
            return super().convert(value, param, ctx)
        if ctx is not None:
            if STDIN in ctx.meta:
                self.fail("- is the standard input, which can be one file only", param, ctx)
            ctx.meta[STDIN] = param
        return STDIN


SOURCE = SourceFile(readable=False)
KEYS: dict[str, bool] = {}
"""Keys that a configuration file can have, and whether each is a flag."""

TRUSTED_KEYS: set[str] = set()
"""Keys that are also allowed in a configuration file that the user did not name."""

PREFIX = "TGOSPA_EVAL_"
"""Prefix of the environment variables that set options."""

TARGET = "tgospa_eval.target"
"""Key of the click context for the target of ``--against``; the value is None if the target is
wrong. With a target, configuration is read only from the target."""

IGNORED = "tgospa_eval.ignored"
"""Key of the click context for environment variables that are ignored because of a target."""

WITH_TARGET = ("against", "junit", "github", "quiet", "verbose", "jobs", "max-input", "memory")
"""Options that do not change the value. With ``--against``, the environment sets only these."""

REMOVED = {
    "--protect": "--against TARGET judges by the suite, the baseline and the configuration of the "
    "target, whatever this branch changes",
    "--history": "keep the output of --format json of each run",
    "gate history": "keep the output of --format json of each run",
    "--format bencher": "--format json has all values",
    "--format github-action-benchmark": "--format json has all values",
}
"""Removed options, and what to use instead."""

LISTED = {
    "with": ("hota", "clear", "identity", "gospa", "nees"),
    "solvers": SOLVERS,
    "pictures": ("png", "svg", "pdf", "none"),
    "components": ("localisation", "missed", "false", "switch"),
    "slice": ("class", "range=", "speed", "size", "density", "age", "region=", "visibility="),
    "ignore": ("marked", "marked-estimates", "outside-truth-steps", "truth-gaps", "in-regions"),
    "sweep": ("c=", "p=", "gamma=", "rho="),
}
"""Values that a shell completes, for options whose value can be a list."""

PLAIN_NUMBERS = ((click.types.FloatParamType, float), (click.types.IntParamType, int))


class Option(click.Option):
    """An option of a command line.

    Parameters
    ----------
    declaration : str
        Names and placeholder, as the help shows them: ``-c, --cutoff C``. Without a placeholder the
        option is a flag.
    text : str
        Help text.
    section : str
        One of `SECTIONS`.
    settings
        Arguments of `click.Option`; also `name`, the name of the parameter of the command. By
        default that is the first long option.
    """

    def __init__(self, declaration: str, text: str, *, section: str, **settings: Any) -> None:
        names = declaration.split(", ")
        names[-1], _, metavar = names[-1].partition(" ")
        name = settings.pop("name", None)
        settings.setdefault("show_default", True)
        super().__init__(
            names if name is None else [*names, name],
            help=text,
            metavar=metavar or None,
            is_flag=None if metavar else True,
            **settings,
        )
        self.section = section

    @property
    def key(self) -> str:
        """Name of the option in a configuration file: its first long name without dashes."""
        return next(name for name in self.opts if name.startswith("--")).lstrip("-")

    def resolve_envvar_value(self, ctx: click.Context) -> str | None:
        """Return the value of the environment variable of this option; None if it is not set.

        With ``--against``, only the variables of `WITH_TARGET` count.
        """
        value = super().resolve_envvar_value(ctx)
        if value is None or TARGET not in ctx.meta or self.key in WITH_TARGET:
            return value
        ctx.meta[IGNORED].append(f"{PREFIX}{self.key.replace('-', '_').upper()}")
        return None

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """Return the value in the type of the option.

        Numbers must be plain decimals, although click accepts other texts such as ``nan``.
        """
        if (typed := f"--{self.key} {value}") in REMOVED:
            raise click.UsageError(removed(typed), ctx)
        for kind, plain in PLAIN_NUMBERS if isinstance(value, str) else ():
            parse, right = PLAIN[plain]
            if isinstance(self.type, kind) and parse(value) is None:
                raise click.BadParameter(f"{value!r} is no {right}", ctx, self)
        return super().type_cast_value(ctx, value)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        """Return the values that a shell offers; in a list with commas, those for its last item."""
        names = LISTED.get(self.key) or getattr(self.type, "choices", ())
        if not names:
            return super().shell_complete(ctx, incomplete)
        from click.shell_completion import CompletionItem  # lazy: few runs are completions

        before, comma, last = incomplete.rpartition("," if self.key in LISTED else "\0")
        given = before.split(",")
        return [
            CompletionItem(f"{before}{comma}{name}")
            for name in names
            if name.startswith(last) and name not in given
        ]

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the names and the text of the help.

        A default that is described in words is not in parentheses. Members of a registry that the
        text does not name are added to it.
        """
        names: Any = getattr(self.type, "choices", ())
        if isinstance(names, Registry) and self.help is not None:
            listed_names = re.findall(r"[\w-]+", self.help)
            unlisted = [name for name in names if name not in listed_names]
            if 0 < len(unlisted) < len(names):
                self.help += f" Also {', '.join(unlisted)}."
        record = super().get_help_record(ctx)
        if record is None or not isinstance(self.show_default, str):
            return record
        names, text = record
        return names, text.replace(f"({self.show_default})", self.show_default)

    def get_help_extra(self, ctx: click.Context) -> "OptionHelpExtra":
        """Return what click adds to the help, but no ranges: the help texts have these already."""
        extra = super().get_help_extra(ctx)
        extra.pop("range", None)
        return extra


def option(
    declaration: str, text: str, *, section: str, trusted: bool = False, **settings: Any
) -> Option:
    """Make an option that environment variables and configuration files can also set.

    The variable is ``TGOSPA_EVAL_<OPTION>``. If `trusted` is true, even a configuration file that
    the user did not name can set the option.
    """
    made = Option(declaration, text, section=section, **settings)
    long = [name[2:] for name in made.opts if name.startswith("--")]
    made.envvar = [PREFIX + name.replace("-", "_").upper() for name in long]
    KEYS[made.key] = made.is_flag
    if trusted:
        TRUSTED_KEYS.add(made.key)
    return made


def load_config(
    ctx: click.Context, parameter: click.Parameter, path: str | None
) -> config.SettingsFile | None:
    """Read a configuration file, and keep the settings for options of this verb.

    This is the callback of ``--config``. Settings of other verbs are no error.
    """
    taken = {
        item.key: item
        for item in ctx.command.params
        if isinstance(item, Option) and item is not parameter and item.envvar
    }
    target: Target | None = ctx.meta.get(TARGET)
    if TARGET not in ctx.meta:
        used = config.load(path, _keys, TRUSTED_KEYS)
    elif target is None:  # the target is wrong: no file is read, and the error follows
        used = None
    else:
        read = target.read if path is None else target.demand
        used = config.load(path, _keys, TRUSTED_KEYS, read)
        used = used and replace(used, path=target.name(used.path))
    ctx.meta[CONFIG] = used
    if used is None:
        return None
    named = {
        str(taken[key].name): (value,) if taken[key].multiple else value
        for key, value in used.options.items()
        if key in taken
    }
    ctx.default_map = {**(ctx.default_map or {}), **named}
    return used


def _keys() -> dict[str, bool]:
    """Return `KEYS` after the import of the gate, which adds its own options."""
    load("gate")
    return KEYS


def tell_settings(ctx: click.Context) -> None:
    """Print the options that a configuration file sets and the user does not set elsewhere."""
    used = ctx.params.get("config")
    if used is None:
        return
    kept = [
        item.key
        for item in ctx.command.params
        if isinstance(item, Option) and not item.hidden
        if ctx.get_parameter_source(str(item.name)) is ParameterSource.DEFAULT_MAP
        if not isinstance(ctx.command, Verb) or ctx.command.uses(ctx, str(item.name))
    ]
    ctx.params["config"] = ctx.meta[CONFIG] = used = used.only(kept)
    if not ctx.params["quiet"] or (used.options and not used.named):
        print_notice(str(used))
        ctx.meta[CONFIG] = None  # errors of options name the file only if it is not printed here


def tell_variables(command: click.Command) -> None:
    """Print which environment variables begin with `PREFIX` but set no option."""
    given = [name for name in os.environ if name.startswith(PREFIX)]
    if {*given} <= (read := {*_variables(command), f"{PREFIX}KERNEL"}):
        return
    for verb in VERBS:
        read |= {*_variables(load(verb))}
    for name in sorted({*given} - read):
        key = name.removeprefix(PREFIX).replace("_", "-").lower()
        if f"--{key}" in long_options(command):
            why = f"--{key} is only for the command line"
        else:
            near = nearest(
                key.upper().replace("-", "_"), [f"--{one.removeprefix(PREFIX)}" for one in read]
            )
            why = f"did you mean {PREFIX}{near[2:]}?" if near else "no such option"
        print_notice(f"{name}: has no effect; {why}")


def _variables(command: click.Command) -> list[str]:
    """Return the environment variables that set options of a verb."""
    several = [item.envvar or () for item in command.params]
    return [name for one in several for name in ([one] if isinstance(one, str) else one)]


def removed(option: str) -> str:
    """Return the message about a removed option."""
    return f"{option} is gone: {REMOVED[option]}"


def dashed(name: str) -> str:
    """Return the long option for the name of a parameter: ``--time-limit`` for time_limit."""
    return f"--{name.removesuffix('_').replace('_', '-')}"


def typed_options(ctx: click.Context) -> set[str]:
    """Return the names of the parameters that were typed on the command line.

    Those that environment variables or a settings file set are left out.
    """
    source = ctx.get_parameter_source
    return {name for name in ctx.params if source(name) is ParameterSource.COMMANDLINE}


# -------------------------------------------------------------------------------------------------
# Help in sections, and suggestions for unknown words.

SECTIONS = (
    "Batch",
    "Gate",
    "Comparison",
    "Scaling study",
    "Scene",
    "Tracker",
    "Metric",
    "Files",
    "Filters",
    "Output",
    "Solver",
    "Gaussians",
    "Particles",
    "General",
)
"""Headings of the sections of the help, in order."""

NEEDED = {"Gaussians": "gaussian-wasserstein", "Particles": "cloud-wasserstein or a sliced one"}
"""Distances to which the options of a section apply."""

OPTION_WORDS = {
    "--format json": "json",
    "--format csv": "csv",
    "--format markdown": "markdown md",
    "--format latex": "latex tex",
    "-o DIR": "out outdir out-dir output-dir dir folder save report html",
    "--pictures FORMATS": "plot plots figure figures image images png svg pdf",
    "--cutoff C": "threshold dist-threshold iou-threshold max-dist max-distance gate",
    "--switch-penalty GAMMA": "switch penalty switch-cost",
    "--distance NAME": "metric norm dist base-distance",
    "--distance iou": "iou",
    "--columns NAMES": "names fields cols header headers",
    "--time A:B": "frames frame frame-range range start end from to",
    "--time-tolerance DT": "tolerance time-tol",
    "--class A": "classes labels",
    "--time-limit SECONDS": "timeout max-time limit",
    "--gap G": "tol rtol accuracy",
    "--jobs N": "threads num-threads workers cores cpus",
    "--force": "overwrite",
    "--quiet": "silent no-progress",
    "--verbose": "debug log",
}
"""For each option, the names that users of other programs type for it."""

SIMILAR = 0.75
"""Smallest similarity of a suggested option to the typed one, such as format for fromat."""


def _print_short(ctx: click.Context, parameter: click.Parameter, given: bool) -> None:  # noqa: ARG001
    """Print the short help; this is the callback of ``-h``."""
    if given and not ctx.resilient_parsing and isinstance(ctx.command, Verb):
        from tgospa_eval.cli.shared.short_help import short_help  # lazy: only for -h

        click.echo(short_help(ctx.command, ctx, ctx.command.sections(ctx)), nl=False)
        ctx.exit()


SHORT_HELP = click.Option(
    ["-h", "short_help"],
    help="Show the options that are used most.",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_short,
)


class Verb(click.Command):
    """Command whose help has sections, and whose errors say what to type."""

    allow_extra_args = True  # `parse_args` reports extra arguments, better than click

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return all options, including those for the short and for the long help."""
        return [*super().get_params(ctx), SHORT_HELP]

    def get_help_option_names(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the options that print the long help."""
        return ["--help", "--help-all"]

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help, or one section of it."""
        if SECTION not in ctx.meta:
            super().format_help(ctx, formatter)
            return
        self.format_usage(ctx, formatter)
        self.format_options(ctx, formatter)

    def sections(self, ctx: click.Context) -> list[str]:
        """Return the headings under which the verb has options."""
        there = {
            getattr(item, "section", SECTIONS[-1])
            for item in self.get_params(ctx)
            if isinstance(item, click.Option) and not item.hidden
        }
        return [name for name in SECTIONS if name in there]

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options below the headings of their sections."""
        wanted = ctx.meta.get(SECTION)
        if wanted is not None:
            near = [name for name in self.sections(ctx) if name.lower().startswith(wanted.lower())]
            if not near:
                raise click.UsageError(
                    f"{self.name} has no section {clipped(wanted)}; there are "
                    f"{', '.join(self.sections(ctx)).lower()}",
                    ctx,
                )
        sections: dict[str, list[tuple[str, str]]] = {name: [] for name in SECTIONS}
        for item in self.get_params(ctx):
            record = item.get_help_record(ctx) if isinstance(item, click.Option) else None
            if record is not None:
                sections[getattr(item, "section", SECTIONS[-1])].append(record)
        measures = any(item.name == "distance" for item in self.params)
        for name, records in sections.items():
            if records and (wanted is None or name in near):
                about = f", with --distance {NEEDED[name]}" if measures and name in NEEDED else ""
                with formatter.section(name + about):
                    formatter.write_dl(records, col_max=28)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments. If the only one is ``help``, it counts as ``--help``.

        Raises
        ------
        click.UsageError
            An option is unknown, or a file is missing.
        """
        self._check_dashes(ctx, args)
        try:
            rest = super().parse_args(ctx, ["--help"] if args == ["help"] else args)
        except click.NoSuchOption as error:
            raise click.UsageError(self._no_option(error.option_name), ctx) from None
        except click.MissingParameter as error:
            if not isinstance(error.param, click.Argument):
                raise
            raise click.UsageError(self._too_few(ctx, error.param), ctx) from None
        if rest and not ctx.resilient_parsing:
            raise click.UsageError(self._too_many(ctx, rest), ctx)
        return rest

    def uses(self, ctx: click.Context, name: str) -> bool:  # noqa: ARG002
        """Return whether an option applies to the arguments.

        By default all options apply. A verb that also takes stored results overrides this method,
        because options of evaluations do not apply to them.
        """
        return True

    def invoke(self, ctx: click.Context) -> Any:
        """Print where settings come from, and run the verb."""
        tell_settings(ctx)
        tell_variables(self)
        return super().invoke(ctx)

    def _check_dashes(self, ctx: click.Context, args: list[str]) -> None:
        """Check that no long option is typed with one dash.

        Click would read ``-output`` as ``-o`` with the value ``utput``.
        """
        known = long_options(self)
        for text in args[: args.index("--")] if "--" in args else args:
            name = f"-{text.partition('=')[0]}"
            if name in known:
                raise click.UsageError(
                    f"{name[1:]}: long options have two dashes; type {name}",
                    ctx,
                )

    def _no_option(self, text: str) -> str:
        if text in REMOVED:
            return removed(text)
        verbs = [verb for verb in VERBS if text in long_options(load(verb))]
        if verbs:
            return f"{text} is not an option of {self.name}, but of {', '.join(verbs)}"
        hint = self._by_another_name(text) or nearest(text, long_options(self))
        return f"no such option: {clipped(text)}" + (f"; did you mean {hint}?" if hint else "")

    def _by_another_name(self, text: str) -> str | None:
        """Return what to type for an option of another program: our option, with a value."""
        bare = text.lstrip("-")
        typed = next((typed for typed, words in OPTION_WORDS.items() if bare in words.split()), "")
        name, _, value = typed.partition(" ")
        for item in self.params:
            if isinstance(item, click.Option) and name in item.opts:
                choices = getattr(item.type, "choices", None) if value.islower() else None
                return typed if choices is None or value in choices else None
        return None

    def _too_few(self, ctx: click.Context, missing: click.Argument) -> str:
        line = [ctx.params.get(item.name or "") or item.make_metavar(ctx) for item in self._files()]
        return f"{missing.make_metavar(ctx)} is missing; type {ctx.command_path} {words(line)}"

    def _too_many(self, ctx: click.Context, rest: list[str]) -> str:
        names = " ".join(item.make_metavar(ctx) for item in self._files())
        return f"too many arguments: {listed(rest)}; type {ctx.command_path} {names}"

    def _files(self) -> list[click.Argument]:
        return [item for item in self.params if isinstance(item, click.Argument)]


def long_options(command: click.Command) -> list[str]:
    """Return the long names, with dashes, of the options in the help of a verb."""
    return [
        name
        for item in command.params
        if isinstance(item, click.Option) and not item.hidden
        for name in item.opts
        if name.startswith("--")
    ]


def words(line: Iterable[str]) -> str:
    """Return arguments as they are typed in a shell.

    Placeholders, such as TRUTH or [ESTIMATE], are not quoted.
    """
    from shlex import quote  # lazy: only for errors

    return " ".join(text if text.strip("[].").isupper() else visible(quote(text)) for text in line)


def nearest(text: str, options: Iterable[str]) -> str | None:
    """Return the option that a typed text could mean; None if there is none.

    If only one option begins with the text, it is returned. If not, the most similar option with
    the same first letter is returned.
    """
    from difflib import get_close_matches  # lazy: only for errors

    bare = text.lstrip("-")
    known = [name.lstrip("-") for name in options]
    begin = [name for name in known if len(bare) > 1 and name.startswith(bare)]
    alike = [name for name in known if name[:1] == bare[:1]]
    matches = begin if len(begin) == 1 else get_close_matches(bare, alike, 1, SIMILAR)
    return f"--{matches[0]}" if matches else None
