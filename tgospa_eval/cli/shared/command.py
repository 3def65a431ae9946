"""Verbs and options for click: declarations, values from settings files, and help."""

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
    """Type for a file to read; - is the standard input, which only one argument can be."""

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
"""Keys of a configuration file, and whether each is a flag."""

TRUSTED_KEYS: set[str] = set()
"""Settings that a configuration file may set even if the user did not name the file."""

PREFIX = "TGOSPA_EVAL_"
"""Prefix of environment variables of options."""

TARGET = "tgospa_eval.target"
"""Key of the context for the target of ``--against``; only its configuration is read."""

IGNORED = "tgospa_eval.ignored"
"""Key of the context for the variables that are ignored with a target."""

WITH_TARGET = ("against", "junit", "github", "quiet", "verbose", "jobs", "max-input", "memory")
"""Options that the environment sets even with a target, because they change no number."""

REMOVED = {
    "--protect": "--against TARGET judges by the suite, the baseline and the configuration of the "
    "target, whatever this branch changes",
    "--history": "keep the documents of --format json, one a run",
    "gate history": "keep the documents of --format json, one a run",
    "--format bencher": "--format json has all values",
    "--format github-action-benchmark": "--format json has all values",
}
"""Removed options, and their replacements."""

LISTED = {
    "with": ("hota", "clear", "identity", "gospa", "nees"),
    "solvers": SOLVERS,
    "pictures": ("png", "svg", "pdf", "none"),
    "components": ("localisation", "missed", "false", "switch"),
    "slice": ("class", "range=", "speed", "size", "density", "age", "region=", "visibility="),
    "ignore": ("marked", "marked-estimates", "outside-truth-steps", "truth-gaps", "in-regions"),
    "sweep": ("c=", "p=", "gamma=", "rho="),
}
"""Values that a shell completes, for options with several values."""

PLAIN_NUMBERS = ((click.types.FloatParamType, float), (click.types.IntParamType, int))


class Option(click.Option):
    """An option of a command line.

    Parameters
    ----------
    declaration : str
        Text of the help: ``-c, --cutoff C``; without a metavar the option is a flag.
    text : str
        Help text.
    section : str
        One of `SECTIONS`.
    settings
        Arguments of `click.Option`; `name` is the parameter, by default the first long option.
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
        """Name in a configuration file: the first long name."""
        return next(name for name in self.opts if name.startswith("--")).lstrip("-")

    def resolve_envvar_value(self, ctx: click.Context) -> str | None:
        """Return the value of its environment variable; None with a target of ``--against``."""
        value = super().resolve_envvar_value(ctx)
        if value is None or TARGET not in ctx.meta or self.key in WITH_TARGET:
            return value
        ctx.meta[IGNORED].append(f"{PREFIX}{self.key.replace('-', '_').upper()}")
        return None

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """Return the value; numbers must be plain decimals, although click accepts others."""
        if (typed := f"--{self.key} {value}") in REMOVED:
            raise click.UsageError(removed(typed), ctx)
        for kind, plain in PLAIN_NUMBERS if isinstance(value, str) else ():
            parse, right = PLAIN[plain]
            if isinstance(self.type, kind) and parse(value) is None:
                raise click.BadParameter(f"{value!r} is no {right}", ctx, self)
        return super().type_cast_value(ctx, value)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> "list[CompletionItem]":
        """Return possible values; in a list with commas those of the last item."""
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
        """Return names and text, without parentheses around a default in words."""
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
        """Return extra help without ranges, which are in the help text."""
        extra = super().get_help_extra(ctx)
        extra.pop("range", None)
        return extra


def option(
    declaration: str, text: str, *, section: str, trusted: bool = False, **settings: Any
) -> Option:
    """Make an option that is also read from TGOSPA_EVAL_<OPTION> and from configuration files.

    `trusted` says whether a file that the user did not name may set the option.
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
    """Load settings of the options that the verb has: callback of --config.

    A file may have settings of other verbs too.
    """
    taken = {
        item.key: item
        for item in ctx.command.params
        if isinstance(item, Option) and item is not parameter and item.envvar
    }
    target: Target | None = ctx.meta.get(TARGET)
    if target is None:
        used = config.load(path, _keys, TRUSTED_KEYS)
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
    """Return all keys; keys of a gate are known after its verb is imported."""
    load("gate")
    return KEYS


def tell_settings(ctx: click.Context) -> None:
    """Report the options that a configuration file sets, once flags and environment are known."""
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
        ctx.meta[CONFIG] = None  # errors of options then do not name it a second time


def tell_variables(command: click.Command) -> None:
    """Report the environment variables with our prefix that no option reads."""
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
    """Return the variables that the options of a verb read."""
    several = [item.envvar or () for item in command.params]
    return [name for one in several for name in ([one] if isinstance(one, str) else one)]


def removed(option: str) -> str:
    """Return the message about a removed option."""
    return f"{option} is gone: {REMOVED[option]}"


def dashed(name: str) -> str:
    """Return the long option of a parameter."""
    return f"--{name.removesuffix('_').replace('_', '-')}"


def typed_options(ctx: click.Context) -> set[str]:
    """Return the parameters of the command line, without those of environment and settings file."""
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
"""Headings of the help, in order."""

NEEDED = {"Gaussians": "gaussian-wasserstein", "Particles": "cloud-wasserstein or a sliced one"}
"""Distance to which a section applies."""

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
"""Words that people type for an option although its name is different."""

SIMILAR = 0.75
"""Least similarity of a suggested option, which also has the same first letter: fromat, format."""


def _print_short(ctx: click.Context, parameter: click.Parameter, given: bool) -> None:  # noqa: ARG001
    """Print the short help: callback of -h."""
    if given and not ctx.resilient_parsing and isinstance(ctx.command, Verb):
        from tgospa_eval.cli.shared.short_help import short_help  # lazy: most runs ask for none

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
    """Command with options in sections, whose messages say what to type."""

    allow_extra_args = True  # messages of ours are longer than those of click

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return all options, including those of the short and the long help."""
        return [*super().get_params(ctx), SHORT_HELP]

    def get_help_option_names(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the options of the long help."""
        return ["--help", "--help-all"]

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help, or one section of it."""
        if SECTION not in ctx.meta:
            super().format_help(ctx, formatter)
            return
        self.format_usage(ctx, formatter)
        self.format_options(ctx, formatter)

    def sections(self, ctx: click.Context) -> list[str]:
        """Return headings of its options."""
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
        """Parse; a lone `help` is --help.

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
        """Return whether an option applies to these arguments; stored results stay as they are."""
        return True

    def invoke(self, ctx: click.Context) -> Any:
        """Report the sources of settings, and run the verb."""
        tell_settings(ctx)
        tell_variables(self)
        return super().invoke(ctx)

    def _check_dashes(self, ctx: click.Context, args: list[str]) -> None:
        """Check that no long option has one dash; click reads -output as -o with value utput."""
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
        """Return the option, with its value, for a name that other programs use."""
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
    """Return the long names, with dashes, of the options that a verb shows."""
    return [
        name
        for item in command.params
        if isinstance(item, click.Option) and not item.hidden
        for name in item.opts
        if name.startswith("--")
    ]


def words(line: Iterable[str]) -> str:
    """Return arguments as typed in a shell; placeholders in capitals may be in brackets."""
    from shlex import quote  # lazy: most command lines are right

    return " ".join(text if text.strip("[].").isupper() else visible(quote(text)) for text in line)


def nearest(text: str, options: Iterable[str]) -> str | None:
    """Suggest the only option that begins with a text, else the most similar option."""
    from difflib import get_close_matches  # lazy: most command lines are right

    bare = text.lstrip("-")
    known = [name.lstrip("-") for name in options]
    begin = [name for name in known if len(bare) > 1 and name.startswith(bare)]
    alike = [name for name in known if name[:1] == bare[:1]]
    matches = begin if len(begin) == 1 else get_close_matches(bare, alike, 1, SIMILAR)
    return f"--{matches[0]}" if matches else None
