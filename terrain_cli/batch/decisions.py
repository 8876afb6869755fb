"""The decision whether an input has to be estimated, by what the manifest says of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from formats.errors import DamagedError
from terrain_cli.batch.batch_folder import result_name

if TYPE_CHECKING:
    from terrain_cli.batch.batch_folder import Folder
    from terrain_cli.batch.batch_input import Input
    from terrain_cli.batch.manifest import ManifestEntry


@dataclass(frozen=True, kw_only=True)
class Wish:
    """What a batch is asked for."""

    configuration: str  # Hash of what decides on the numbers
    twin: str = ""  # That of the same but for --salvage, which makes no difference to a whole input
    salvage: bool = False
    kind: str = "parquet"  # "parquet" or "csv": of the results
    force: bool = False  # Do again what is done
    retry_failed: bool = False  # Do again what failed, although nothing has changed


def reason(item: Input, folder: Folder, wish: Wish) -> str | None:
    """Say why something is to be done for an input; None if what the manifest says of it still holds."""
    entry = folder.latest.get(item.location)
    if entry is None:
        return "new"
    key = str(entry.sha256), entry.configuration
    failed = entry.status == "failed"
    duplicate = entry.status == "duplicate"
    whole = key in folder.kept and folder.has_result(entry, result_name(item.location, wish.kind))
    reasons = (
        ("forced", wish.force),
        ("cannot be read", item.problem is not None),
        ("changed", not same(item, entry)),
        ("other options", not _holds(entry, folder, wish)),
        ("failed in passing", failed and entry.passing),
        ("failed before", failed and wish.retry_failed),
        ("its copy has changed", duplicate and folder.holders.get(key, item.location) == item.location),
        ("result missing", entry.status == "ok" and not whole),
    )
    return next((why for why, holds in reasons if holds), None)


def key(sha256: str, folder: Folder, wish: Wish) -> tuple[str, str]:
    """Return under which configuration a content is known, or else will be: the key of `Folder.holders`."""
    own, other = (sha256, wish.configuration), (sha256, wish.twin)
    holder = folder.latest.get(folder.holders.get(other, ""))
    return other if own not in folder.holders and holder and _regardless(holder, wish) else own


def _holds(entry: ManifestEntry, folder: Folder, wish: Wish) -> bool:
    """Tell whether the options of an entry give what those of now would give."""
    if entry.configuration != wish.twin:
        return entry.configuration == wish.configuration
    holder = folder.holders.get((str(entry.sha256), wish.twin), entry.location)
    return _regardless(folder.latest[holder], wish)


def _regardless(entry: ManifestEntry, wish: Wish) -> bool:
    """Tell whether an input is one to which --salvage makes no difference."""
    if entry.status == "failed":
        return wish.salvage and entry.error_class != DamagedError.__name__
    return entry.recovered_of is None


def same(item: Input, entry: ManifestEntry) -> bool:
    """Tell whether an input is what it was, without reading it."""
    return item.stamp is not None and (item.size, item.stamp) == (entry.size, entry.stamp)
