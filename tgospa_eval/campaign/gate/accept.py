"""The options that accept what a gate found, for the command that it proposes."""

import glob
from collections import Counter
from collections.abc import Iterable, Sequence

from tgospa_eval.campaign.gate.baseline import Baseline
from tgospa_eval.campaign.gate.outcome import PairOutcome
from tgospa_eval.campaign.gate.rules import Verdict
from tgospa_eval.campaign.gate.suite import GroupTable
from tgospa_eval.campaign.pairs import Job
from tgospa_eval.common.words import natural


def without_option(arguments: Sequence[str], option: str) -> list[str]:
    """Arguments without an option that has a value."""
    kept = [text for text in arguments if not text.startswith(f"{option}=")]
    if option in kept:
        at = kept.index(option)
        del kept[at : at + 2]
    return kept


def accepting_options(
    outcomes: Iterable[PairOutcome],
    groups: Sequence[GroupTable],
    pairs: Sequence[Job],
    old: Baseline,
) -> list[str]:
    """The options that accept what failed or may be tightened, and nothing else."""
    there = {pair.name: pair for pair in pairs}
    labels = {name: entry.get("labels", {}) for name, entry in old.items()}
    labels |= {name: pair.labels for name, pair in there.items()}

    def meant(bad: Iterable[PairOutcome]) -> set[str]:
        names = set[str]()
        for one in bad:
            if not one.group:
                names.add(one.name)
                continue
            lost = one.verdict is Verdict.INCOMPARABLE
            names |= {
                name
                for name, own in labels.items()
                if any(one.name in (t.group_of(own), f"all of {t.name}") for t in groups)
                if not lost or (name in there) != (name in old)
            }
        return names

    names = meant(
        one
        for one in outcomes
        if one.verdict is Verdict.INCOMPARABLE
        or any(found.verdict is Verdict.FAIL for found in one.findings)
    )
    if not names and not any(one.status for one in outcomes):
        names = meant(one for one in outcomes if any(found.improved for found in one.findings))
    if not names:
        return []
    some = [] if names >= there.keys() else _patterns(names, {*there, *old})
    chosen = [text for pattern in some for text in ("--only", pattern)]
    return ["--update-baseline", *(["--prune"] if names - there.keys() else []), *chosen]


def _patterns(names: set[str], everything: set[str]) -> list[str]:
    """Patterns that match these names and none of the others: `slow/*` where all of it is meant."""
    all_of, meant_of = (
        Counter(name.partition("/")[0] for name in some if "/" in name)
        for some in (everything, names)
    )
    found = dict[str, None]()  # in order, each once
    for name in sorted(names, key=natural):
        head, slash, _ = name.partition("/")
        whole = slash and 1 < all_of[head] == meant_of[head]
        found[f"{glob.escape(head)}/*" if whole else glob.escape(name)] = None
    return [*found]
