"""A Dask scheduler with workers on this machine, as processes."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from browser import PATIENCE
from checkout import ROOT


class Running:
    """A cluster that runs.

    Attributes
    ----------
    address : str
        Of the scheduler.
    scheduler : Popen
        Its process.
    """

    def __init__(self, address: str, scheduler: "subprocess.Popen[bytes]") -> None:
        self.address, self.scheduler = address, scheduler

    def workers(self) -> list[int]:
        """Process ids of the workers that are connected."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return list(client.run(os.getpid).values())

    def wait_for(self, workers: int) -> None:
        """Wait until so many workers are connected."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=PATIENCE)

    def tasks(self) -> int:
        """Tasks that the scheduler knows."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks))


@contextmanager
def cluster(folder: Path, workers: int = 2, *, nanny: bool = True) -> Iterator[Running]:
    """A scheduler and workers of one thread each; ports are those that are free.

    A nanny begins a worker that was killed once more.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("COVERAGE", "TGOSPA_EVAL_"))}
    environment = kept | {
        "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests" / "support"))),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
        # By default each process looks 50 times a second how it is, and workers 100 times.
        "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
        "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    }
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    asked = ["--host", "127.0.0.1", "--port", "0", *common]
    begun: list[subprocess.Popen[bytes]] = []

    def begin(*arguments: str) -> "subprocess.Popen[bytes]":
        with (folder / "log.txt").open("ab") as log:
            process = subprocess.Popen(
                [*dask, *arguments], cwd=folder, env=environment, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip
        begun.append(process)
        return process

    try:
        scheduler = begin("scheduler", *asked)
        for number in range(workers):
            own = ["--nthreads", "1", "--local-directory", str(number)]
            begin("worker", *common, *own, "--nanny" if nanny else "--no-nanny")
        until = time.monotonic() + PATIENCE
        while not file.exists() or not (text := file.read_text(encoding="utf-8")).endswith("}"):
            assert scheduler.poll() is None, (folder / "log.txt").read_text(encoding="utf-8")
            assert time.monotonic() < until, "no scheduler"
            time.sleep(0.02)
        running = Running(json.loads(text)["address"], scheduler)
        running.wait_for(workers)
        yield running
    finally:
        for process in begun:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
