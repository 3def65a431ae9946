"""Proof folders of a result: one, or one for each class."""

import hashlib
import os
from collections.abc import Mapping
from urllib.parse import quote

from tgospa_eval.evaluation.by_class import EvaluationByClass
from tgospa_eval.evaluation.pair import PairEvaluation
from tgospa_eval.proof.write import check_proofs, proof_texts
from tgospa_eval.results.evaluation import Evaluation
from tgospa_eval.results.proof import PairProof
from tgospa_eval.show.files import PROOF, write_texts
from tgospa_eval.text import as_unicode

NO_NAME = "%20"
"""Folder of objects without a class: no name is quoted so."""

LONGEST_NAME = 200
"""Characters of a name as that of a folder; file systems take 255 with the digest of the rest."""


def proof_files(result: Evaluation, options: Mapping[str, object]) -> dict[str, str]:
    """The files of a proof folder, or of one for each class, by path in it.

    Parameters
    ----------
    result : Evaluation
        Of one evaluation, or of several classes.
    options : mapping of str to object
        How the files were read and compared: `Request` that are no defaults.

    Raises
    ------
    ConfigError
        A proof folder has no place for what was evaluated.
    SolverError
        A checker finds that a folder does not prove what it claims.
    """
    files: dict[str, str] = {}
    written = []
    for folder, part, origin in sorted(_parts(result), key=lambda part: part[0]):
        origin |= {
            "options": dict(options),
            "judged": part.judged,
            "inputs": {
                role: {"path": as_unicode(str(result.files[role])), "sha256": record["sha256"]}
                for role, record in part.input.items()
            },
        }
        texts = proof_texts(part.proof, origin)
        written.append(texts)
        files |= {f"{folder}{name}": text for name, text in texts.items()}
    check_proofs(written)
    return files


def _parts(result: Evaluation) -> list[tuple[str, PairEvaluation, dict[str, object]]]:
    """Folder, result, and what the proof says of where it comes from."""
    if isinstance(result, EvaluationByClass):
        return [
            (f"{folder_name(name)}/", part, {"class": name, "classes": list(result.results)})
            for name, part in result.results.items()
        ]
    assert isinstance(result, PairEvaluation)
    return [("", result, {})]


def folder_name(name: str) -> str:
    """A name of the user's as that of a folder in a folder; different names stay different."""
    text = quote(name, safe=" ")
    if text.startswith("."):
        text = f"%2E{text[1:]}"
    if len(text) > LONGEST_NAME:
        text = f"{text[:LONGEST_NAME]}%~{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return text or NO_NAME


def save(proof: PairProof, folder: "str | os.PathLike[str]", *, force: bool = False) -> None:
    """Write one proof folder: `Proof.save`.

    Raises
    ------
    ConfigError
        The folder cannot be written, or holds files of others, or has no place for the result.
    SolverError
        A checker finds that it does not prove what it claims.
    """
    texts = proof_texts(proof)
    check_proofs([texts])
    write_texts(texts, os.fspath(folder), PROOF, force=force, option="folder")
