"""The process beside ours: it ends instead of us, and the next call has another."""

import os
import subprocess
import sys

import pytest

from tgospa_eval import engines
from tgospa_eval.engines import DiedError, call_in_helper

pytestmark = pytest.mark.process


@pytest.fixture
def anew() -> None:
    """The next call begins a process."""
    with pytest.raises(DiedError):
        call_in_helper(os._exit, 0)


def test_one_process_for_all_calls() -> None:
    number = call_in_helper(os.getpid)
    assert call_in_helper(os.getpid) == number != os.getpid()
    with pytest.raises(ZeroDivisionError):
        call_in_helper(divmod, 1, 0)
    assert call_in_helper(os.write, 1, b"what a library prints") == 21
    assert call_in_helper(os.getpid) == number


def test_what_ends_it_ends_one_call() -> None:
    number = call_in_helper(os.getpid)
    with pytest.raises(DiedError, match="status 3"):
        call_in_helper(os._exit, 3)
    if sys.platform != "win32":
        with pytest.raises(DiedError, match="status -6"):
            call_in_helper(os.abort)
    assert call_in_helper(os.getpid) != number


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_has_its_own() -> None:
    code = (
        "import os, sys\nfrom tgospa_eval.engines import call_in_helper as call\n"
        "first = call(os.getpid)\n"
        "if os.fork() == 0:\n    sys.exit(call(os.getpid) == first)\n"
        "assert os.wait()[1] == 0\nassert call(os.getpid) == first\n"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)


def test_no_process_can_be_started(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/none")
    with pytest.raises(FileNotFoundError):
        call_in_helper(os.getpid)


def test_a_process_that_ends_as_it_begins(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "SERVE", "raise SystemExit(7)")
    with pytest.raises(OSError, match="it ended at its start, with status 7"):
        call_in_helper(os.getpid)
