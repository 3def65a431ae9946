"""An explanation as a table. Computes nothing that is not in it."""

from tgospa_eval.common.words import number, sizes_in_words
from tgospa_eval.reports.console import WORST, headline, part_rows, repair_notes, repair_table
from tgospa_eval.reports.phrases import parameters_of
from tgospa_eval.reports.tables import Document
from tgospa_eval.results.explanation import Explanation


def explanation_document(found: Explanation) -> Document:
    """What cost most, and the repairs."""
    result = found.result
    parts = ", ".join(f"{name} {share}" for name, _, share, _, _ in part_rows(result))
    worst = result.worst()
    return Document(
        title=headline(result),
        lines=[
            parameters_of(result.parameters),
            sizes_in_words(result.sizes),
            f"total {number(result.total)}: {parts}",
            *(
                f"{words}: {', '.join(map(str, worst[kind]))}"
                for kind, words in WORST.items()
                if worst[kind]
            ),
        ],
        tables=[repair_table(result, found)] if found.repairs else [],
        notes=list(repair_notes(found)),
        warnings=result.told,
    )
