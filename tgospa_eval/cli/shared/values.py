"""Values of the options of output; what a verb has no option for keeps its default here."""

from tgospa_eval.api.options import Values
from tgospa_eval.common.config import SettingsFile
from tgospa_eval.common.frozen import dataclass


@dataclass(frozen=True, kw_only=True)
class OutputOptions(Values):
    """Of everything that prints and writes. Parameters as in `cli.shared.click_options`."""

    format_: str = "table"
    output: str | None = None
    force: bool = False
    proof: bool = False
    pictures: str = "none"
    style: str = "screen"
    components: str | None = None
    plane: str | None = None
    config: SettingsFile | None = None
    quiet: bool = False
    verbose: bool = False
