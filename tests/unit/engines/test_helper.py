"""The process beside ours: it ends instead of us, and the next call has another."""

import os
import subprocess
import sys

import pytest

from tgospa_eval.engines import helper
from tgospa_eval.engines.engine import DiedError

pytestmark = pytest.mark.process


@pytest.fixture
def anew() -> None:
    """The next call begins a process."""
    with pytest.raises(DiedError):
        helper.call(os._exit, 0)


def test_one_process_for_all_calls() -> None:
    number = helper.call(os.getpid)
    assert helper.call(os.getpid) == number != os.getpid()
    with pytest.raises(ZeroDivisionError):
        helper.call(divmod, 1, 0)
    assert helper.call(os.write, 1, b"what a library prints") == 21
    assert helper.call(os.getpid) == number


def test_what_ends_it_ends_one_call() -> None:
    number = helper.call(os.getpid)
    with pytest.raises(DiedError, match="status 3"):
        helper.call(os._exit, 3)
    if sys.platform != "win32":
        with pytest.raises(DiedError, match="status -6"):
            helper.call(os.abort)
    assert helper.call(os.getpid) != number


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_has_its_own() -> None:
    code = (
        "import os, sys\nfrom tgospa_eval.engines.helper import call\nfirst = call(os.getpid)\n"
        "if os.fork() == 0:\n    sys.exit(call(os.getpid) == first)\n"
        "assert os.wait()[1] == 0\nassert call(os.getpid) == first\n"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)


def test_no_process_can_be_started(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/none")
    with pytest.raises(FileNotFoundError):
        helper.call(os.getpid)


def test_a_process_that_ends_as_it_begins(anew: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(helper, "SERVE", "raise SystemExit(7)")
    with pytest.raises(OSError, match="it ended as it began, with status 7"):
        helper.call(os.getpid)
