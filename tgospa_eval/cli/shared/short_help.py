"""Short help of a verb, for ``-h``: usage, one example, and the most used options by task."""

import re
import textwrap
from collections.abc import Iterable

import click

WIDTH = 80
_LINE_BREAK = r"\s*\\\n\s*"

METRIC = {
    "cutoff": "distance beyond which nothing is matched",
    "switch-penalty": "what a track switch costs",
    "distance": "euclidean, iou, haversine, mahalanobis, ...",
}
READING = {
    "columns": "columns to compare x,y; your headers id=track,x=px",
    "class": "only rows of these classes",
}
TOLERANCE = {"time-tolerance": "join times that differ by at most DT"}

COMMON_OPTIONS: dict[str, dict[str, dict[str, str]]] = {
    "evaluate": {
        "Choose the metric": METRIC,
        "Read the files": READING | TOLERANCE,
        "See more": {
            "output": "write page, tables and pictures to this folder",
            "format": "table, json, csv, markdown, latex, methods",
            "explain": "show the repairs that save most",
            "with": "also hota, clear, identity, gospa, nees",
        },
    },
    "inspect": {
        "Look": {
            "plot": "draw what is in the files",
            "cutoff": "distance beyond which nothing is matched",
            "distance": METRIC["distance"],
            "format": "a table or json",
        },
        "Read the files": READING
        | TOLERANCE
        | {
            "truth-format": "format of TRUTH, if it is not recognised",
            "estimate-format": "format of ESTIMATE, if it is not recognised",
            "where": "only rows that pass: 'score >= 0.5'",
        },
    },
    "explain": {
        "Choose the metric": METRIC,
        "Read the files": READING | TOLERANCE,
        "Repair": {
            "top": "how many repairs to show",
            "apply": "the repair to write to the file of -o",
            "output": "where to write it",
            "format": "a table or json",
        },
    },
    "gate": {
        "Judge": {
            "baseline": "JSON file with the values to compare with",
            "update-baseline": "make the baseline, or replace it",
            "fail-on": "rule: total:+2%, counts.switch:+0",
            "max": "limit without a baseline: tgospa=50",
            "suite": "judge the pairs of files of this TOML file",
            "against": "judge by a revision's baseline and suite",
        },
        "Choose the metric": METRIC,
        "See more": {"format": "table, json or markdown"},
    },
    "compare": {
        "Compare": {
            "solvers": "compare solvers, not estimates",
            "with": "also hota, clear, identity, gospa, nees",
        },
        "Choose the metric": METRIC,
        "Read the files": READING | TOLERANCE,
        "See more": {
            "output": "write page, tables and pictures to this folder",
            "format": "table, json, csv, markdown or latex",
        },
    },
    "batch": {
        "Say what there is": {
            "truth": "path with fields: gt/{run}.csv",
            "estimate": "paths with fields: out/{tracker}/{run}.csv",
            "layout": "folders of a benchmark: motchallenge or kitti",
        },
        "Choose the metric": METRIC,
        "Run, and show": {
            "output": "folder of the results; the same command resumes",
            "workers": "number of processes",
            "by": "labels that group the tables",
            "format": "table, json, csv, markdown or latex",
        },
    },
    "verify": {
        "Check": {
            "script": "the program that checks",
            "covariance": "the file that this option named",
            "inner-cov": "the same",
            "region": "the same",
            "ignore-regions": "the same",
        },
    },
    "simulate": {
        "Make a scene": {
            "scenario": "how targets move",
            "targets": "number of targets",
            "steps": "number of steps",
            "state": "point, gaussian, cloud or box",
            "seed": "the same seed makes the same files",
        },
        "Make errors": {
            "noise": "standard deviation in each coordinate",
            "detection": "probability of a report",
            "swaps": "probability that near targets exchange tracks",
            "false-rate": "new false tracks per step",
        },
        "Write": {"format": "csv, motchallenge or kitti"},
    },
    "associate": {
        "Choose what is near": {
            "cutoff": "distance beyond which nothing is associated",
            "distance": METRIC["distance"],
        },
        "Read the files": READING
        | TOLERANCE
        | {
            "a-format": "format of A, if it is not recognised",
            "b-format": "format of B, if it is not recognised",
        },
        "See more": {
            "output": "write page, table and picture to this folder",
            "cost-matrix": "write the distances of all pairs",
            "format": "table, json or csv",
        },
    },
    "reduce": {
        "Reduce": {
            "size": "particles of each cloud",
            "reduce-method": "sliced, recursive, atl, kmeans, systematic, ...",
            "seed": "seed of the random choices",
            "restarts": "number of starts; the best result is kept",
        },
        "Read the files": {
            "in-format": "format of the file, if it is not recognised",
            "columns": READING["columns"],
            "where": "only rows that pass: 'score >= 0.5'",
            "time": "only the steps from A to B",
        },
        "Write": {
            "format": "a table, json or csv",
            "force": "write over a file that exists",
        },
    },
}
"""Options of the short help, for each verb and task: the name in a settings file, and a text."""


def short_help(command: click.Command, ctx: click.Context, sections: Iterable[str]) -> str:
    """Return the short help: usage, purpose, an example, common options, and the other sections."""
    verb = str(command.name)
    options = {
        name.lstrip("-"): item
        for item in command.params
        if isinstance(item, click.Option)
        for name in item.opts
        if name.startswith("--")
    }
    text = re.sub(r"\s+", " ", (command.help or "").partition("\n\n")[0]).strip()
    examples = re.findall(r"^ *(tgospa-eval (?:.*\\\n *)*.*?)(?:  .*)?$", command.help or "", re.M)
    whole = (re.sub(_LINE_BREAK, " ", one) for one in examples)
    example = next(one for one in whole if len(one) <= WIDTH - 2)
    lines = [command.get_usage(ctx), "", text, "", f"  {example}", ""]
    for task, common in COMMON_OPTIONS[verb].items():
        lines.append(f"{task}:")
        for key, about in common.items():
            item = options[key]
            names = [*[name for name in item.opts if len(name) == 2], f"--{key}"]
            metavar = (item.metavar or "").replace(" ", "")
            metavar = " FORMAT" if metavar.startswith("[") else f" {metavar}" * bool(metavar)
            lines.append(f"  {', '.join(names) + metavar:27} {about}")
    listed = f"Sections: {', '.join(sections).lower()}."
    more = f"tgospa-eval help {verb} SECTION shows one, tgospa-eval {verb} --help all."
    return "\n".join([*lines, "", *textwrap.wrap(listed, WIDTH), more, ""])
