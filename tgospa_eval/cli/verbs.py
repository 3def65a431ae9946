"""The verbs by name; each is imported when it is asked for."""

from importlib import import_module

import click

VERBS = {
    "evaluate": ("evaluate.command", "Evaluate an estimate; the verb if none is given."),
    "inspect": ("inspect", "Show what is in the files, and what looks wrong."),
    "explain": ("explain", "Show which single repairs would save most, proven."),
    "gate": ("gate", "Fail a CI job if the estimate got worse."),
    "compare": ("compare.command", "Rank several estimates, or compare solvers."),
    "batch": ("batch", "Evaluate a whole benchmark or study."),
    "verify": ("verify", "Check the proof of a value, in exact integers."),
    "simulate": ("simulate", "Make a ground truth and an estimate to try it on."),
    "associate": ("associate", "Associate the states of two sensors."),
    "reduce": ("reduce", "Reduce particle clouds to fewer particles."),
}
"""Module and summary of each verb; the module's command is called `command`."""

SECTION = "tgospa_eval.section"
"""Under this name the context keeps the section that `help VERB SECTION` asks for."""

CONFIG = "tgospa_eval.common.config"
"""Under this name the context keeps the configuration file in use."""


def load(verb: str) -> click.Command:
    """Import a verb."""
    command: click.Command = import_module(f"tgospa_eval.cli.{VERBS[verb][0]}").command
    return command
