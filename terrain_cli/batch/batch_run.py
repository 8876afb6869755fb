"""A batch from its inputs to the mission table."""

from __future__ import annotations

import json
import time
from contextlib import closing
from dataclasses import astuple, dataclass
from hashlib import sha256
from typing import TYPE_CHECKING

from formats.limits import COPY_GB
from terrain_cli.batch import batch_folder, batch_inputs, mission_table
from terrain_cli.batch.batch_folder import CONFIGURATIONS, Folder
from terrain_cli.batch.batch_inputs import Arrivals
from terrain_cli.batch.configuration import versions
from terrain_cli.batch.coordinator import Keeper
from terrain_cli.batch.worker_pool import LocalPool
from terrain_cli.batch.worker_tasks import Job
from terrain_cli.errors import TerrainError, UnfinishedError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from terrain_cli.batch.batch_inputs import Input
    from terrain_cli.batch.configuration import Configuration
    from terrain_cli.batch.coordinator import Tally
    from terrain_cli.batch.worker_pool import Pool
    from terrain_cli.batch.worker_tasks import Reply

#: Seconds between two looks at what workers have done, and at what has arrived.
_TICK, _LOOK = 0.2, 1.0
#: And at least so many times as long as such a look takes.
_PAUSE = 10


@dataclass(frozen=True, kw_only=True)
class Order:
    """How a batch is to be run."""

    kind: str = "parquet"  # "parquet" or "csv": of the results
    also: tuple[str, ...] = ()  # Further kinds of the mission table
    jobs: int = 1
    scheduler: str | None = None
    timeout: float | None = None  # Seconds that one input may take
    memory: int | None = None  # Bytes that one worker may take
    largest: int = int(COPY_GB * 1e9)  # Bytes that are copied from a store at the most
    force: bool = False
    retry_failed: bool = False
    fail_fast: bool = False
    # To go on taking what arrives: seconds for which an input must have stayed as it is
    settle: float | None = None

    def wish(self, configuration: Configuration) -> batch_folder.Wish:
        """Return what decides on what is to be done."""
        return batch_folder.Wish(
            configuration=configuration.hash,
            twin=configuration.twin,
            salvage=configuration.settings.salvage,
            kind=self.kind,
            force=self.force,
            retry_failed=self.retry_failed,
        )


def preview(
    items: Sequence[Input], directory: str, configuration: Configuration, order: Order
) -> list[tuple[str, Input]]:
    """Return what would be done, and why; the folder need not be there."""
    with Folder(directory, writable=False) as folder:
        wish = order.wish(configuration)
        reasons = [
            (batch_folder.reason(item, folder, wish), item) for item in items if not folder.own(item.location)
        ]
    return [(why, item) for why, item in reasons if why is not None]


def run(
    names: Sequence[str],
    found: Sequence[Input],
    directory: str,
    configuration: Configuration,
    order: Order,
    report: Callable[[Tally], None] = lambda _: None,
) -> Tally:
    """Do what is new or changed among inputs found under some names, and assemble the mission table.

    `report` is called several times a second. Whatever ends a batch, what it has finished is kept.
    """
    if order.settle is None and found and all(item.problem for item in found):
        raise next(item.problem for item in found if item.problem)
    with Folder(directory) as folder:
        _document(folder, configuration)
        job = Job(
            rover=configuration.rover,
            settings=configuration.resolved,
            crs=configuration.crs,
            kind=order.kind,
            largest=order.largest,
            versions=versions(),
        )
        with closing(_workers(order)) as pool:
            keeper = Keeper(folder, pool, job, order.wish(configuration))
            if order.settle is None:
                keeper.add(item for item in found if not folder.own(item.location))
                _finish(keeper, order, report)
                keeper.lost()
            else:
                _watch(keeper, names, folder, configuration, order, report)
        _assemble(folder, configuration, order)
    return keeper.tally


def _workers(order: Order) -> Pool:
    if order.scheduler is None:
        return LocalPool(order.jobs, order.timeout, order.memory)
    from terrain_cli.batch.dask_cluster import Cluster

    return Cluster(order.scheduler, order.timeout, order.memory)


def _finish(keeper: Keeper, order: Order, report: Callable[[Tally], None]) -> None:
    while not keeper.idle and not (order.fail_fast and keeper.tally.failures):
        keeper.step(_TICK)
        report(keeper.tally)


def _watch(
    keeper: Keeper,
    names: Sequence[str],
    folder: Folder,
    configuration: Configuration,
    order: Order,
    report: Callable[[Tally], None],
) -> None:
    arrivals = Arrivals(order.settle or 0.0)
    assembled = -1
    next_look = 0.0
    while not (order.fail_fast and keeper.tally.failures):
        if (began := time.monotonic()) >= next_look:
            here = [item for item in batch_inputs.discover(names) if not folder.own(item.location)]
            keeper.add(arrivals.rested(here))
            # A folder of very many files is not looked at all the time.
            now = time.monotonic()
            next_look = now + max(_LOOK, _PAUSE * (now - began))
        if not keeper.idle:
            keeper.step(_TICK)
        elif keeper.tally.done != assembled:
            _assemble(folder, configuration, order)
            assembled = keeper.tally.done
        else:
            time.sleep(_TICK)
        report(keeper.tally)


def _document(folder: Folder, configuration: Configuration) -> None:
    name = f"{CONFIGURATIONS}/{configuration.hash}.json"
    if not (folder.path / name).exists():
        text = json.dumps(configuration.document, ensure_ascii=False, indent=2, allow_nan=False)
        folder.put(name, text.encode() + b"\n")


def _assemble(folder: Folder, configuration: Configuration, order: Order) -> None:
    """Bring the mission table up to what the manifest says, if it is not."""
    if not folder.latest:
        return
    kinds = tuple(dict.fromkeys(("parquet", *order.also)))
    names = [*(f"{mission_table.TABLE}.{kind}" for kind in kinds), mission_table.SUMMARY]
    parts, account = mission_table.parts(folder), mission_table.account(folder)
    told = [[astuple(part) for part in parts], account, configuration.hash, kinds]
    digest = sha256(json.dumps(told, default=str).encode()).hexdigest()

    def note() -> bytes:
        here = (folder.path / name for name in names)
        sizes = [path.lstat().st_size if path.exists() else None for path in here]
        return f"{digest} {sizes}\n".encode()

    if folder.assembled == note():
        return
    task = mission_table.Assemble(
        folder=str(folder.path),
        parts=parts,
        account=account,
        settings=configuration.settings,
        crs=configuration.crs,
        kinds=kinds,
    )
    with closing(LocalPool(1)) as desk:
        desk.submit(0, task)
        done: list[tuple[int, Reply]] = []
        while not done:
            done = desk.collect(_TICK)
    why = done[0][1].failure
    if why:
        text = f"the table of all inputs: {why.error}"
        if why.error_class == "WorkerLostError":
            # Nothing is lost: the same command makes the table of what it has.
            raise UnfinishedError(text, hint=why.hint)
        error = TerrainError(text, hint=why.hint)
        error.exit_code = why.exit_code
        raise error
    for name in names:
        folder.publish(name)
    folder.assembled = note()
