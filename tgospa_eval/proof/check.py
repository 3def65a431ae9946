"""Checks of proof folders in exact integers. Each folder claims bounds of TGOSPA."""

import os
from collections.abc import Callable, Iterator
from contextlib import suppress

from tgospa_eval.common.frozen import dataclass
from tgospa_eval.errors import ConfigError, InputError
from tgospa_eval.proof import PROOF_FOLDER, verify_tgospa
from tgospa_eval.quoting import visible


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Outcome of the check of one proof.

    Parameters
    ----------
    folder : str
        Path of the proof folder.
    holds : bool
        Whether the proof confirms the claimed bounds.
    text : str
        Computed bounds, or what is wrong.
    """

    folder: str
    holds: bool
    text: str

    def __str__(self) -> str:
        return visible(f"{self.folder}: {self.text}")


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Outcomes of the checks of all proofs in a folder; true if all claims hold.

    Parameters
    ----------
    claims : tuple of Claim
        A single claim, or a claim for each class.
    """

    claims: tuple[Claim, ...]

    @property
    def holds(self) -> bool:
        """True if all claims hold."""
        return all(claim.holds for claim in self.claims)

    def __bool__(self) -> bool:
        return self.holds

    def __str__(self) -> str:
        return "\n".join(map(str, self.claims))


def verify(folder: "str | os.PathLike[str]") -> Verification:
    """Check the proof in a folder, or the proofs of all classes in it.

    A program of one file, which shares no code with the solver, computes both bounds again with
    exact integers. The command ``tgospa-eval verify`` does the same, and can also check that the
    tables of the proof follow from the data files.

    Parameters
    ----------
    folder : str or path
        A proof folder, as `Result.proof` saves it, or a result folder with a proof folder in it.

    Returns
    -------
    Verification
        Outcome of each proof; true if all hold.

    Raises
    ------
    InputError
        The folder is not a proof folder, or a file is missing or damaged.
    """
    return check_folders(os.fspath(folder), check)


def check_folders(folder: str, judge: Callable[[str, verify_tgospa.Folder], Claim]) -> Verification:
    """Check all proofs in a folder, each with `judge`.

    The total work of all checks is limited.

    Raises
    ------
    InputError
        The folder has no proof, or a proof in it is a link to another place.
    """
    folders = _folders(folder)
    claims = [] if folders == [folder] else list(_missing_classes(folder, folders))
    files, home = None, os.path.realpath(folder)
    for path in folders:
        if os.path.commonpath((home, os.path.realpath(path))) != home:
            raise InputError(f"{path}: is a link out of {folder}; name the folder it leads to")
        files = verify_tgospa.Folder(path, files)
        claims.append(judge(path, files))
    return Verification(claims=tuple(claims))


def check(folder: str, files: verify_tgospa.Folder, more: Callable[[], str] = str) -> Claim:
    """Check the proof in one folder.

    Parameters
    ----------
    folder : str
        Path of the folder.
    files : Folder
        Reader of its files.
    more : callable
        Function for a further check. It returns its outcome in words, or raises `Wrong`.

    Raises
    ------
    InputError
        A file is missing or damaged.
    """
    try:
        return Claim(folder=folder, holds=True, text=f"{verify_tgospa.verify(files)}{more()}")
    except verify_tgospa.Wrong as error:
        return Claim(folder=folder, holds=False, text=visible(str(error)))
    except verify_tgospa.DAMAGED as error:
        if isinstance(error, (ConfigError, InputError, MemoryError)):
            raise
        raise InputError(
            f"{folder}: not a complete proof: {type(error).__name__}: {error}"
        ) from None


def _folders(folder: str) -> list[str]:
    """Return the folders with a proof: the folder itself, or the folders of classes in it.

    If there are none, its folder ``proof`` is searched in the same way.
    """
    for path in (folder, os.path.join(folder, PROOF_FOLDER)):
        folders = [path] if _has_proof(path) else list(filter(_has_proof, _below(path)))
        if folders:
            return folders
    raise InputError(
        f"{folder}: there is no proof.json in it; tgospa-eval TRUTH ESTIMATE -o DIR --proof writes "
        "one, as does Result.proof.save(folder) in Python"
    )


def _missing_classes(folder: str, folders: list[str]) -> Iterator[Claim]:
    """Yield a failed claim for each class that is named in a proof, but has no proof of its own."""
    there, needed = set(), set()
    for path in folders:
        with suppress(*verify_tgospa.DAMAGED):  # `check` reports damaged files
            document = verify_tgospa.Folder(path).proof()
            there.add(document.get("class"))
            needed.update(document.get("classes", ()))
    for name in sorted(needed - there):
        text = f"there is no proof of the class {name!r}"
        yield Claim(folder=folder, holds=False, text=text)


def _has_proof(path: str) -> bool:
    return os.path.isfile(os.path.join(path, "proof.json"))


def _below(path: str) -> Iterator[str]:
    try:
        yield from (os.path.join(path, name) for name in sorted(os.listdir(path)))
    except NotADirectoryError:
        raise InputError(f"{path}: is a file; name the folder that it is in") from None
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
