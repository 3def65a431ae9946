"""An option, and where its value comes from: command line, environment, configuration file."""

from collections.abc import Callable
from typing import Any

import click

from tgospa_eval.cli.shared.help import Option
from tgospa_eval.cli.verbs import CONFIG
from tgospa_eval.common import config

KEYS: dict[Callable[[Any], Any], tuple[str, bool]] = {}
"""Of each option its key in a configuration file, and whether it is a flag."""


def option(*names: str, section: str, **settings: Any) -> Callable[[Any], Any]:
    """Make a click option that also reads the environment variable TGOSPA_EVAL_<OPTION>."""
    long = [name.lstrip("-") for name in names if name.startswith("--")]
    variables = ["TGOSPA_EVAL_" + name.replace("-", "_").upper() for name in long]
    made = click.option(
        *names,
        cls=Option,
        section=section,
        envvar=variables,
        **{"show_default": True, **settings},
    )
    KEYS[made] = long[0], settings.get("is_flag", False)
    return made


def load_config(ctx: click.Context, parameter: click.Parameter, path: str | None) -> str | None:
    """Callback of --config: settings of the options that the verb has.

    A file may hold those of other verbs as well.
    """
    taken = {
        item.key: item
        for item in ctx.command.params
        if isinstance(item, Option) and item is not parameter and item.envvar
    }
    used, settings = config.load(path, dict(KEYS.values()))
    ctx.meta[CONFIG] = used
    named = {
        taken[key].name: (value,) if taken[key].multiple else value
        for key, value in settings.items()
        if key in taken
    }
    ctx.default_map = {**(ctx.default_map or {}), **named}
    return used
