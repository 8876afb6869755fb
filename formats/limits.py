"""How much an untrusted file may make this program do: far beyond real logs, far below what harms."""

from __future__ import annotations

MIB = 1 << 20

#: Bytes that one chunk of a bag, or one compressed message, may unpack to.
CHUNK_BYTES = 256 * MIB
#: What anything may unpack to, however small it was packed.
UNPACKED_BYTES = 16 * MIB
#: Beyond that, times its packed size. Logs pack 3 to 50 times, and gzip at its best 1,032 times.
UNPACKED_RATIO = 250
#: What a packed text table may unpack to, however small it was packed.
TEXT_BYTES = 1 << 30
#: Columns of a text table.
COLUMNS = 10_000
#: Rows that a Parquet file may claim for each of its bytes, once there are ten million.
PARQUET_ROWS_PER_BYTE = 1_000
PARQUET_ROWS = 10_000_000

#: Of one message definition, and of all those of a bag: characters.
DEFINITION_CHARACTERS = 512 << 10
DEFINITIONS_CHARACTERS = 16 * MIB
#: Of one message definition: lines that are neither blank nor comments, and types.
DEFINITION_LINES = 20_000
DEFINITION_TYPES = 1_000
#: Fields of one message, those of its members included, and how deep they may nest.
LEAVES = 20_000
DEPTH = 50
#: Texts or messages in a list of fixed length: rosbags writes a line of code for each.
FIXED_LIST = 4_096
#: Of metadata.yaml and of the like inside bags: bytes.
METADATA_BYTES = 4 * MIB
#: Connections of one bag.
CONNECTIONS = 20_000


class TooMuchError(ValueError):
    """Something in a file goes beyond one of these bounds; the text says what."""


def unpacked_limit(packed: int, most: int = CHUNK_BYTES) -> int:
    """Return how many bytes something packed may become.

    Parameters
    ----------
    packed : int
        Bytes.
    most : int
        Never more than this.

    Returns
    -------
    int
    """
    return min(most, max(UNPACKED_BYTES, UNPACKED_RATIO * packed))
