"""Options for click: made from the fields of `api.options.Request` and others, and for output."""

from collections.abc import Callable, Collection, Container, Sequence
from dataclasses import Field, fields, replace
from functools import partial
from types import UnionType
from typing import Any, get_args

import click

from tgospa_eval.api.options import OPTION_SPECS, Request
from tgospa_eval.cli.shared.command import PATH, Option, load_config, option
from tgospa_eval.common.config import OptionSpec, SettingsFile, Values
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.words import parsed_size
from tgospa_eval.errors import ConfigError

REPORT_FORMATS = ("table", "json", "csv", "markdown", "latex", "siunitx")

_output = partial(option, section="Output")
_general = partial(option, section="General")


class Size(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4
    """Type for a number of bytes: 4GB, 500MB, 1.5GiB; a plain number means GB."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the bytes."""
        try:
            return parsed_size(value)
        except ConfigError as error:
            self.fail(str(error), param, ctx)


def one_of(members: Collection[str]) -> Any:
    """Return the type of an option whose value is one of `members`.

    `members` can be a registry, such as the registry of distances. Other packages can add members
    to it.
    """
    kind: Any = click.Choice(())
    kind.choices = members  # not as an argument, because click would make a tuple of a registry
    return kind


def options_of(record: type[Values]) -> dict[str, Option]:
    """Return the options that a dataclass declares, by their names in a settings file."""
    known = ((field, field.metadata["setting"]) for field in fields(record) if field.metadata)
    return {about.key: _made(field, about) for field, about in known}


def _made(field: Field[Any], about: OptionSpec) -> Option:
    """Return the option that a field declares."""
    kind, default = field.type, field.default
    base = next(iter(get_args(kind))) if isinstance(kind, UnionType) else kind
    given: dict[str, Any] = {"show_default": about.shown or True}
    if field.name != about.key.replace("-", "_"):
        given["name"] = field.name
    if about.choices:
        given["type"] = one_of(about.choices)
    elif about.kind:
        given["type"] = {"path": PATH, "size": Size()}[about.kind]
    elif base is int:
        given["type"] = click.IntRange(about.low, about.high)
    elif base is float:
        given["type"] = float if about.low is None else click.FloatRange(about.low)
    if default == ():
        given["multiple"] = True
    elif default is not None and default is not False:
        given["default"] = default
    if about.stored:
        given["trusted"] = about.trusted
    make: Any = option if about.stored else Option
    made: Option = make(about.declaration, about.help, section=about.section, **given)
    return made


def side_option(name: str, side: str) -> Option:
    """Return an option of truth or estimate with another word: truth-format becomes a-format."""
    field, role = Request.__dataclass_fields__[name], name.partition("_")[0]
    about: OptionSpec = field.metadata["setting"]
    declaration, text = about.declaration.replace(role, side), about.help
    changed = replace(about, declaration=declaration, help=text.replace(role.upper(), side.upper()))
    return _made(field, changed)


OPTIONS = options_of(Request)
"""Options of the fields of `Request`, by their names in a settings file."""

EVALUATION = tuple(OPTIONS[about.key] for about in OPTION_SPECS.values() if about.everywhere)

IN_PARTS_OPTIONS = (OPTIONS["memory"], OPTIONS["scheduler"])
WITH, SLICE, UNIT = OPTIONS["with"], OPTIONS["slice"], OPTIONS["unit"]
BY_OF_SETTINGS = option(
    "--by class", "", section="Filters", type=click.Choice(("class",)), hidden=True
)
"""Hidden option of verbs that do not evaluate by class. In a settings file, they ignore it."""

PARTICLES = tuple(item for item in EVALUATION if item.section == "Particles")
REDUCTION = tuple(
    item
    for item in PARTICLES
    if item.key == "reduce-method" or OPTION_SPECS[str(item.name)].methods
)
"""Options that say how to reduce particle clouds. The value None means that one is not given."""

CONFIG_FILE = Option(
    "--config FILE",
    "Read settings from a TOML file, whose keys are the names of these options. Without this "
    "option, a file in the current folder is used, which can set only what is evaluated.",
    section="General",
    is_eager=True,
    callback=load_config,
    type=PATH,
    envvar="TGOSPA_EVAL_CONFIG",
    show_default="tgospa-eval.toml, else [tool.tgospa-eval] in pyproject.toml, in this folder",
)
QUIET = _general("-q, --quiet", "Print no notices; warnings stay.")

VERBOSE = _general("-v, --verbose", "Print stages and their times on stderr.")

PICTURE_OPTIONS = (
    _output(
        "--pictures FORMATS",
        "Formats of the pictures of -o: png, svg, pdf, several with commas; or none.",
        default="png",
    ),
    _output(
        "--style NAME",
        "Style of the pictures: screen; or paper for one column of a journal, paper-wide for "
        "both, without titles.",
        type=click.Choice(("screen", "paper", "paper-wide")),
        default="screen",
    ),
    _output(
        "--components PARTS",
        "Parts of the cost in the pictures: localisation, missed, false, switch; several with "
        "commas.",
        show_default="all four",
    ),
    _output(
        "--plane X,Y",
        "Axes of the picture of trajectories: two state columns, or one and t.",
        show_default="the first two columns",
    ),
)
"""Options of the pictures of one evaluation in the folder of ``-o``."""

PICTURES = PICTURE_OPTIONS[:2]
"""Options that apply to pictures of all verbs."""

STYLE = PICTURES[1]

FORCE = _output("--force", "Write into a folder with other files in it.")


def report_format(
    make: Callable[..., Option] = option, csv: str = "csv", more: Sequence[str] = ()
) -> Option:
    """Return the option ``--format`` of a report.

    `csv` is the text of the help about CSV. `more` are formats that only one verb has.
    """
    return make(
        "--format FORMAT",
        f"What to print: table, json, {csv}, markdown, latex, siunitx (LaTeX, aligned digits)."
        + " For a paper: methods, a paragraph that says what was computed." * bool(more),
        name="format_",
        section="Output",
        type=click.Choice((*REPORT_FORMATS, *more)),
        default="table",
    )


COLUMNS_OF_TABLE = Option(
    "--columns-of-table NAMES",
    "Columns of the table, with commas: jobs, tgospa, interval, loc, missed, false, switch, place, "
    "p, numbers of the summary such as rmse, and of --with such as hota.",
    callback=lambda _, __, text: tuple(filter(None, map(str.strip, (text or "").split(",")))),
    section="Output",
    show_default="those that add information",
)
"""Option that chooses the columns of a table with a row for each tracker or group."""

OUTPUT = (
    report_format(csv="csv (the costs of each step)", more=("methods",)),
    _output(
        "-o, --output DIR",
        "Write result.json, CSV tables, report.html and pictures to this folder.",
        type=PATH,
    ),
    *PICTURE_OPTIONS,
    FORCE,
    CONFIG_FILE,
    QUIET,
    VERBOSE,
)


OF_PICTURES = tuple(item.key for item in PICTURE_OPTIONS)


@dataclass(frozen=True, kw_only=True)
class OutputOptions(Values):
    """Values of the options of printing and writing. Options that a verb lacks have defaults."""

    format_: str = "table"
    output: str | None = None
    force: bool = False
    proof: bool = False
    geojson: bool = False
    pictures: str = "none"
    style: str = "screen"
    components: str | None = None
    plane: str | None = None
    columns_of_table: tuple[str, ...] = ()
    config: SettingsFile | None = None
    quiet: bool = False
    verbose: bool = False


SOLVING_KEYS = (
    *("switch-penalty", "rho", "step-weights", "existence"),
    *(item.key for item in EVALUATION if item.section == "Solver"),
)
"""Options that only verbs with a solver have, by their names in a settings file."""

READING = (
    *(item for item in EVALUATION if item.key not in SOLVING_KEYS and item not in PARTICLES),
    CONFIG_FILE,
    QUIET,
)
"""Options of verbs that read files and measure distances, but solve nothing."""


def chosen_options(keys: Container[str], *more: Option) -> tuple[Option, ...]:
    """Return options of an evaluation by their names in a settings file, and `more` options."""
    return (*(item for item in EVALUATION if item.key in keys), *more, CONFIG_FILE, QUIET)


def format_option(*names: str) -> Option:
    """Return the option ``--format`` of a verb that has only these formats.

    A settings file cannot set it.
    """
    return Option(
        f"--format [{'|'.join(names)}]",
        "What to print.",
        name="format_",
        section="Output",
        type=click.Choice(names),
        default="table",
    )
