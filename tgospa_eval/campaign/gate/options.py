"""Options of a gate: rules and files to write. Few imports, so that ``--help`` is fast."""

from collections.abc import Callable, Mapping
from dataclasses import field
from fnmatch import fnmatchcase
from functools import partial

from tgospa_eval.common.config import SettingsFile, Values, setting
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.quoting import clipped

_stored = partial(setting, "Gate", trusted=False)
_gate = partial(setting, "Gate", stored=False)


@dataclass(frozen=True, kw_only=True)
class GateOptions(Values):
    """Rules to judge by, settings of the evaluation, and files to write.

    The value of an option is searched in this order: flag, environment, suite, configuration file,
    baseline, default. `evaluation` has the options of the evaluation by name. `sources` says where
    the value of each parameter comes from: ``commandline``, ``environment``, ``default_map`` (a
    configuration file) or ``default``. `typed` has the arguments of the command line, for commands
    that messages propose.
    """

    baseline: str | None = _stored(
        "--baseline FILE",
        "Baseline to judge by, a JSON file that --update-baseline makes. A suite may name its own.",
    )
    suite: str | None = _stored(
        "--suite FILE",
        "TOML file that lists several pairs of files, instead of TRUTH ESTIMATE.",
    )
    fail_on: tuple[str, ...] = _stored(
        "--fail-on RULE",
        "Fail if a value is worse than in the baseline by more than this: total:+1%, "
        "counts.switch:+2; or is not in a range: nees:1.5..2.5. Values have the names of the JSON. "
        "Repeatable.",
        default=(),
        shown="total:+0.001%",
    )
    warn_on: tuple[str, ...] = _stored(
        "--warn-on RULE", "A rule as for --fail-on that only warns. Repeatable.", default=()
    )
    maximum: tuple[str, ...] = _stored(
        "--max NAME=VALUE",
        "Fail if a value is above this, whatever the baseline says: tgospa=45. Repeatable. "
        "Without other rules no baseline is needed.",
        default=(),
    )
    junit: str | None = _stored("--junit FILE", "Write a JUnit XML report.")
    github: bool = _stored(
        "--github",
        "Write annotations to stderr, and a summary to the file that GITHUB_STEP_SUMMARY names.",
    )
    update_baseline: bool = _gate(
        "--update-baseline",
        "Make the baseline, or renew the entries of all pairs, and exit with 0.",
    )
    add: bool = _gate(
        "--add",
        "With --update-baseline, add this run to the nights of the baseline, at most 10 together: "
        "limits are judged against their mean.",
    )
    strict: bool = _gate(
        "--strict",
        "Fail if a group has new runs, or is above its limit although seeds may be the reason.",
    )
    against: str | None = _gate(
        "--against TARGET",
        "Judge the estimates of this branch by the suite, the baseline, the truths and the "
        "configuration of a target: a git revision such as origin/main, or a folder such as "
        "./target. Such files of this branch, and environment variables, are ignored.",
    )
    newer_than: str | None = _gate(
        "--newer-than FILE|TIME",
        "Fail estimates that are older than this file or time (2026-11-28T06:00): the tracker did "
        "not run.",
    )
    output: str | None = _gate(
        "-o, --output DIR",
        "Write gate.html, gate.md and gate.json to this folder, and a page for each pair.",
    )
    force: bool = _gate("--force", "Write into a folder with other files in it.")
    only: tuple[str, ...] = _gate(
        "--only PATTERN",
        "With --update-baseline, renew only the entries of these pairs: 'slow/*'. Repeatable.",
        default=(),
    )
    prune: bool = _gate(
        "--prune",
        "With --update-baseline, remove entries of pairs that no longer exist.",
    )
    group: str | None = _gate(
        "--group LABELS",
        "Add up all pairs that agree in these labels of their patterns, such as scenario, and "
        "judge the sums by --fail-on. The label all adds up all pairs. Runs with different seeds "
        "show whether a change is more than noise.",
    )
    confidence: float | None = _gate(
        "--confidence P",
        "Confidence of the tests by runs with different seeds: a tracker that is as good as the "
        "limit fails in at most 1 - P of all gates.",
        shown="0.975",
    )
    seed_label: str | None = _gate(
        "--seed-label LABEL", "Label in which the runs of one scene differ.", shown="seed"
    )
    proof: str | None = _gate(
        "--proof DIR",
        "Write the proof of each value: to DIR/run, with --update-baseline to DIR/baseline.",
    )

    evaluation: Mapping[str, object] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    typed: tuple[str, ...] = ()
    quiet: bool = False
    verbose: bool = False
    config: SettingsFile | None = None

    def given(self, *sources: str) -> dict[str, object]:
        """Return the options of the evaluation whose values come from these sources, by name."""
        return {
            name: value
            for name, value in self.evaluation.items()
            if self.sources.get(name) in sources
        }

    def strong(self, name: str) -> bool:
        """Return whether an option is given as a flag or by the environment."""
        return self.sources.get(name) in ("commandline", "environment")

    def chosen(self, name: str) -> bool:
        """Return whether an update renews the entry of this pair."""
        return not self.only or any(fnmatchcase(name, pattern) for pattern in self.only)

    @property
    def renewed(self) -> Callable[[str], bool] | None:
        """Function that says for a name if an update renews its entry; None without an update."""
        return self.chosen if self.update_baseline else None

    def prefix(self, name: str) -> str:
        """Return the beginning of a line about a pair: its name if there is a suite, else blank."""
        return f"{clipped(name)}: " if self.suite else ""
