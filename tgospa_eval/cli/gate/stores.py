"""A gate over stores of batches: nothing is solved, what was proven is compared."""

import json
import os
from collections.abc import Mapping
from dataclasses import replace

from tgospa_eval._version import __version__
from tgospa_eval.batches.store import SETTINGS_FILE, Row, Store
from tgospa_eval.cli.gate.sources import PATHS_GIVEN, Given, relative_path
from tgospa_eval.cli.shared.options import BY_KEY, EVALUATION
from tgospa_eval.cli.verbs import TYPED
from tgospa_eval.common.frozen import dataclass
from tgospa_eval.common.notices import Notice
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.regression.baseline import Baseline, Entry, dump, load, make_entry
from tgospa_eval.regression.measured import Measured, values_of
from tgospa_eval.regression.outcome import Outcome, Report, change, compare, leftover, update_notes
from tgospa_eval.regression.rules import Rule, Verdict
from tgospa_eval.regression.suite import Pair
from tgospa_eval.reports.files import write_file
from tgospa_eval.text import quoted
from tgospa_eval.tracks.judged import judged_of

JUDGED_COLUMNS = ("parameters", "judged.truth_sha256", "normalised.tgospa")
"""Columns without which rows cannot be judged."""


def is_store(path: str | None) -> bool:
    """Whether it is the folder of a batch."""
    return path is not None and os.path.isfile(os.path.join(path, SETTINGS_FILE))


def load_baseline(path: str) -> Baseline | None:
    """A baseline from a file, or from the jobs of a store that have a value; None without it.

    Raises
    ------
    ConfigError, InputError
        It cannot be read, or is no baseline of this version.
    """
    if not is_store(path):
        return load(path)
    stored = _Stored.of(path)
    return {name: make_entry(now, stored.options(name, path)) for name, now in stored.now.items()}


def check_updated(path: str | None) -> None:
    """Whether this can be written as a baseline.

    Raises
    ------
    ConfigError
        It is the folder of a batch.
    """
    if is_store(path):
        raise ConfigError(
            f"--baseline {path}: is a batch, which tgospa-eval batch makes; --update-baseline "
            "writes a file"
        )


def judge_stores(given: Given, first: str, second: str | None) -> Report:
    """Judge the jobs of a store by a baseline, by another store, or by limits alone.

    Parameters
    ----------
    given : Given
        The options.
    first : str
        The store; with `second` the one that is the baseline.
    second : str, optional
        The store that is judged.

    Raises
    ------
    TgospaError
        Nothing can be judged.
    """
    gate = given.gate
    _check_options(given)
    if second is not None and given.strong("baseline"):
        raise ConfigError("name the baseline once: OLD_STORE NEW_STORE, or STORE --baseline FILE")
    if second is not None and not is_store(second):
        raise ConfigError(f"{second}: holds no batch, and {first} does; name two stores or one")
    judged, path = (first, gate.baseline) if second is None else (second, first)
    if gate.update_baseline:
        if not path:
            raise ConfigError("no baseline: name the file to make with --baseline FILE")
        check_updated(path)
    stored = _Stored.of(judged)
    rules = {name: given.rules(pair, baseline=bool(path)) for name, pair in stored.pairs.items()}
    old = load_baseline(path) if path else None
    if path and gate.update_baseline:
        return _update_store(stored, old or {}, path)
    missing = f"no such file: {path}" if old is None else f"not in {path}"
    outcomes = [
        _store_outcome(stored, pair, (old or {}).get(name), rules[name])
        if name in stored.faults or not path or (old and name in old)
        else Outcome.of(pair, Verdict.INCOMPARABLE, missing)
        for name, pair in stored.pairs.items()
    ]
    outcomes += leftover(
        old or {}, rules, Verdict.INCOMPARABLE, f"in the baseline and not in {judged}"
    )
    again = ("tgospa-eval", "gate", *given.context.meta[TYPED], "--update-baseline")
    return Report(
        baseline=path or "",
        outcomes=tuple(outcomes),
        version=__version__,
        again=() if is_store(path) else again,
    )


def _check_options(given: Given) -> None:
    """Whether no option is given that is for evaluating.

    Raises
    ------
    ConfigError
        One is given.
    """
    typed = [item.key for item in EVALUATION if given.typed(str(item.name))]
    if given.gate.proof:
        typed.append("proof")
    if typed:
        raise ConfigError(f"--{typed[0]}: stores are compared as they are, nothing is evaluated")
    if given.typed("suite"):
        raise ConfigError("give a store or --suite, not both")


@dataclass(frozen=True, kw_only=True)
class _Stored:
    """The jobs of a store by name: labels, and own options, as in ``careful/SIM-01 cutoff=5``.

    Parameters
    ----------
    pairs : mapping of str to Pair
        All jobs.
    now : mapping of str to Measured
        Those that have a value.
    faults : mapping of str to str
        Why the others have none.
    rows : mapping of str to mapping
        Their rows.
    settings : mapping of str to object
        Options of the batch, by parameter.
    """

    pairs: Mapping[str, Pair]
    now: Mapping[str, Measured]
    faults: Mapping[str, str]
    rows: Mapping[str, Row]
    settings: Mapping[str, object]

    @classmethod
    def of(cls, folder: str) -> "_Stored":
        """Read a store.

        Raises
        ------
        InputError
            It cannot be read, has no rows, or is one of an older version.
        """
        store = Store(folder)
        settings, table = store.settings(), store.rows()
        if not len(table):
            raise InputError(f"{folder}: no job of this batch is done")
        done = table["status"] != "failed"
        if done.any() and not all(name in table for name in JUDGED_COLUMNS):
            raise InputError(f"{folder}: was made by an older version; make it anew with batch")
        labels = [str(name) for name in table.columns if str(name).startswith("label.")]
        rows = {}
        for values in table.to_dict("records"):
            row = {str(name): value for name, value in values.items()}
            name = _name(row, labels)
            if name in rows:
                raise InputError(f"{folder}: two jobs are called {quoted(name)}; rename a label")
            rows[name] = row
        failed = {name for name, row in rows.items() if row["status"] == "failed"}
        return cls(
            pairs={
                name: Pair(name=name, truth=row["truth"], estimate=row["estimate"])
                for name, row in rows.items()
            },
            now={name: _measured(row) for name, row in rows.items() if name not in failed},
            faults={name: f"failed in {folder}: {rows[name]['message']}" for name in failed},
            rows=rows,
            settings=settings["options"],
        )

    def options(self, name: str, path: str) -> dict[str, object]:
        """Options of a job as a baseline records them, by their names in a configuration file."""
        keys = {str(item.name): key for key, item in BY_KEY.items()}
        found = {keys[parameter]: value for parameter, value in self.settings.items()}
        found = {
            key: ",".join(map(str, value)) if isinstance(value, list) else value
            for key, value in found.items()
        }
        row = self.rows[name]
        own = {key.replace("_", "-"): value for key, value in json.loads(row["options"]).items()}
        found |= own | {"cutoff": row["cutoff"], "switch-penalty": row["switch_penalty"]}
        for name in (name for name in PATHS_GIVEN if name in found):
            found[name] = relative_path(str(found[name]), os.path.dirname(path))
        return found


def _name(row: Row, labels: list[str]) -> str:
    """What a job is called, as a suite calls it whose fields are these labels."""
    own = [f"{key}={value}" for key, value in json.loads(row["options"]).items()]
    return " ".join(("/".join(str(row[name]) for name in labels) or row["estimate"], *own))


def _measured(row: Row) -> Measured:
    """What a gate judges of a row."""
    return Measured(
        values=values_of(row, row["cutoff"] ** row["order"]),
        bounds=(row["lower_bound"], row["upper_bound"]),
        parameters=json.loads(row["parameters"]),
        judged=judged_of(row),
        version=row["version"],
        status=row["message"],
        certified=bool(row["certified"]),
    )


def _store_outcome(stored: _Stored, pair: Pair, entry: Entry | None, rules: list[Rule]) -> Outcome:
    """The verdict on a job."""
    if pair.name in stored.faults:
        return Outcome.of(pair, Verdict.ERROR, stored.faults[pair.name])
    verdict, findings, notes = compare(stored.now[pair.name], entry, rules)
    return _with_row(
        replace(Outcome.of(pair, verdict, *notes), findings=findings), stored.rows[pair.name]
    )


def _with_row(outcome: Outcome, row: Row) -> Outcome:
    """With what the row has: how long it took, and warnings about the data."""
    warnings = tuple(Notice(**record) for record in json.loads(row["warnings"]))
    return replace(outcome, seconds=float(row["seconds"]), warnings=warnings)


def _update_store(stored: _Stored, old: Baseline, path: str) -> Report:
    """Make the baseline of all jobs, or not at all, and list what changed."""
    if stored.faults:
        raise InputError(*(f"{name}: {fault}" for name, fault in stored.faults.items()))
    new = {name: make_entry(now, stored.options(name, path)) for name, now in stored.now.items()}
    outcomes = [
        _with_row(
            replace(
                Outcome.of(
                    pair, Verdict.UPDATED, *update_notes(old.get(name), new[name], stored.now[name])
                ),
                changes=change(old.get(name), new[name]),
            ),
            stored.rows[name],
        )
        for name, pair in stored.pairs.items()
    ]
    outcomes += leftover(old, new, Verdict.UPDATED, "removed: it is not in the batch")
    if new != old or not os.path.exists(path):
        write_file(path, dump(new), "--baseline")
    return Report(baseline=path, outcomes=tuple(outcomes), version=__version__)
