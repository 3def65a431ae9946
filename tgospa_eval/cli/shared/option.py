"""How an option is declared, and where its value comes from: command line, environment, file."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import click
from click.core import ParameterSource

from tgospa_eval.cli.shared.streams import print_notice
from tgospa_eval.cli.verbs import CONFIG
from tgospa_eval.common import config
from tgospa_eval.common.files import STDIN
from tgospa_eval.common.words import parsed, parsed_whole

if TYPE_CHECKING:
    from click.types import OptionHelpExtra

PATH = click.Path(readable=False)


class SourceFile(click.Path):
    """A file that is read, or - for the standard input, which can be one of them."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, or the name of the standard input."""
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
"""Those that a configuration file may set which was only found: what is evaluated."""

PLAIN_NUMBERS: tuple[tuple[type, Callable[[str], float | None], str], ...] = (
    (click.types.FloatParamType, parsed, "plain, finite number; write it as 2.5 or 1e-3"),
    (click.types.IntParamType, parsed_whole, "whole number; write it as 10"),
)


class OptionSettings(TypedDict, total=False):
    """Of `click.Option`; `name` is the parameter, if it is not the first long option."""

    name: str
    type: "click.ParamType[Any] | type[float]"
    default: object
    show_default: bool | str
    multiple: bool
    required: bool
    hidden: bool
    callback: Callable[[click.Context, click.Parameter, Any], object]
    is_eager: bool
    envvar: str


class Option(click.Option):
    """An option of a command line.

    Parameters
    ----------
    declaration : str
        As help shows it: ``-c, --cutoff C``; without a metavar it is a flag.
    text : str
        Its help.
    section : str
        One of `cli.shared.help.SECTIONS`.
    """

    def __init__(
        self, declaration: str, text: str, *, section: str, **settings: Unpack[OptionSettings]
    ) -> None:
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
        """Its name in a configuration file: the first long one."""
        return next(name for name in self.opts if name.startswith("--")).lstrip("-")

    def type_cast_value(self, ctx: click.Context, value: Any) -> Any:
        """The value; a number is a plain one, where click takes any that Python has."""
        for kind, parse, right in PLAIN_NUMBERS if isinstance(value, str) else ():
            if isinstance(self.type, kind) and parse(value) is None:
                raise click.BadParameter(f"{value!r} is no {right}", ctx, self)
        return super().type_cast_value(ctx, value)

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Names and text; a default in words needs no parentheses of its own."""
        record = super().get_help_record(ctx)
        if record is None or not isinstance(self.show_default, str):
            return record
        names, text = record
        return names, text.replace(f"({self.show_default})", self.show_default)

    def get_help_extra(self, ctx: click.Context) -> "OptionHelpExtra":
        """Without ranges, which the texts have in words."""
        extra = super().get_help_extra(ctx)
        extra.pop("range", None)
        return extra


def option(
    declaration: str,
    text: str,
    *,
    section: str,
    trusted: bool = False,
    **settings: Unpack[OptionSettings],
) -> Option:
    """Make an option that is also read from TGOSPA_EVAL_<OPTION> and from configuration files.

    `trusted`: whether a file may set it that was only found.
    """
    made = Option(declaration, text, section=section, **settings)
    long = [name[2:] for name in made.opts if name.startswith("--")]
    made.envvar = ["TGOSPA_EVAL_" + name.replace("-", "_").upper() for name in long]
    KEYS[made.key] = made.is_flag
    if trusted:
        TRUSTED_KEYS.add(made.key)
    return made


def load_config(
    ctx: click.Context, parameter: click.Parameter, path: str | None
) -> config.SettingsFile | None:
    """Callback of --config: settings of the options that the verb has.

    A file may hold those of other verbs as well.
    """
    taken = {
        item.key: item
        for item in ctx.command.params
        if isinstance(item, Option) and item is not parameter and item.envvar
    }
    used = config.load(path, KEYS, TRUSTED_KEYS)
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


def tell_settings(ctx: click.Context) -> None:
    """Say which options a configuration file sets, now that flags and environment are known."""
    used = ctx.params.get("config")
    if used is None:
        return
    kept = [
        item.key
        for item in ctx.command.params
        if isinstance(item, Option) and not item.hidden
        if ctx.get_parameter_source(str(item.name)) is ParameterSource.DEFAULT_MAP
    ]
    ctx.params["config"] = ctx.meta[CONFIG] = used = used.only(kept)
    if not ctx.params["quiet"] or (used.options and not used.named):
        print_notice(str(used))
        ctx.meta[CONFIG] = None  # an error of an option says it no second time
