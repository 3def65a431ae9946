"""Proof folders of a result: one, or one for each class."""

import os
from collections.abc import Mapping
from urllib.parse import quote

from tgospa_eval.proof.write import proof_texts
from tgospa_eval.reports.folders import PROOF, write_texts
from tgospa_eval.results.by_class import ByClass
from tgospa_eval.results.result import Proof, Result
from tgospa_eval.results.summary import Summary

FOLDER = "proof"
"""Of a result folder."""

NO_CLASS = "%20"
"""Folder of the objects without a class: no name of a class is quoted so."""


def proof_files(result: Summary, options: Mapping[str, object]) -> dict[str, str]:
    """The files of the proof folders by path in the result folder.

    Parameters
    ----------
    result : Summary
        Of one evaluation, or of several classes.
    options : mapping of str to object
        How the files were read and compared: `EvaluationOptions` that are no defaults.

    Raises
    ------
    SolverError
        A proof does not hold.
    """
    files: dict[str, str] = {}
    for folder, part, origin in _parts(result):
        origin |= {
            "options": dict(options),
            "inputs": {
                role: {"path": result.files[role], "sha256": record["sha256"]}
                for role, record in part.input.items()
            },
        }
        for name, text in proof_texts(part.proof, origin).items():
            files[f"{folder}/{name}"] = text
    return files


def _parts(result: Summary) -> list[tuple[str, Result, dict[str, object]]]:
    """Folder, result, and what the proof says of where it comes from."""
    if isinstance(result, ByClass):
        return [
            (f"{FOLDER}/{quote(name, safe=' ') or NO_CLASS}", part, {"class": name})
            for name, part in result.results.items()
        ]
    assert isinstance(result, Result)
    return [(FOLDER, result, {})]


def save(proof: Proof, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
    """Write one proof folder: `Proof.save`."""
    write_texts(proof_texts(proof), os.fspath(folder), PROOF, force=force, option="folder")
