"""Settings of files as click would have made them of the same options."""

from collections.abc import Mapping

import click

from tgospa_eval.cli.shared.options import BY_KEY, KNOWN
from tgospa_eval.common import config
from tgospa_eval.errors import ConfigError
from tgospa_eval.text import quoted


def typed_options(
    context: click.Context, settings: Mapping[str, object], where: str
) -> dict[str, object]:
    """Values of options of an evaluation, by parameter; `where` begins the messages.

    Raises
    ------
    ConfigError
        An option is unknown, or its value has no meaning.
    """
    values: dict[str, object] = {}
    for key, value in config.settings_of(settings, where, KNOWN).items():
        item = BY_KEY[key]
        try:
            values[str(item.name)] = item.type_cast_value(
                context, (value,) if item.multiple else value
            )
        except click.BadParameter as error:
            raise ConfigError(f"{where}: {quoted(key)}: {error.message}") from None
        except (ValueError, OverflowError) as error:
            raise ConfigError(f"{where}: {quoted(key)}: {error}") from None
    return values
