"""Limits for files that may be hostile: far more than real logs need, far less than what harms a machine."""

import os

MIB = 1 << 20

CHUNK_BYTES = 256 * MIB  # Bytes that one chunk of a bag, or one compressed message, may unpack to
UNPACKED_BYTES = 16 * MIB  # What anything may unpack to, however small it was packed
#: Beyond that, times its packed size. Logs pack 3 to 50 times, and gzip at its best 1,032 times.
UNPACKED_RATIO = 250
FILE_BYTES = 1 << 30  # What all of a file may unpack to together, however small it was packed
#: NUL bytes of a text table. A power cut leaves what the file system had set aside for the file and
#: not written; judged: far more than that, and read in a second.
NUL_BYTES = 64 * MIB
COLUMNS = 10_000  # Columns of a table
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
FIXED_LIST = 4_096  # Texts or messages in a list of fixed length
#: Texts or messages in the lists of one message, which are walked one by one. Judged: three times the points
#: of a dense cloud.
WALKED = 1_000_000
METADATA_BYTES = 4 * MIB  # Of metadata.yaml and of the like inside bags: bytes
CONNECTIONS = 20_000  # Connections of one bag

#: GB of a pipe, a packed recording or an object of a store that are copied to the disk (judged: above the
#: logs of a day, below the disks of today); --largest, or this variable, says another number.
COPY_GB = 16.0
COPY_VARIABLE = "TERRAIN_EST_LARGEST"
SPARE_BYTES = 64 * MIB  # Left free on the disk that holds a copy
#: Seconds in which somebody must begin to write into a pipe (judged: a shell starts both ends at once).
PIPE_SECONDS = 10.0


def largest_copy() -> int:
    """Return how many bytes may be copied to the disk."""
    return int(float(os.environ.get(COPY_VARIABLE) or COPY_GB) * 1e9)


class TooMuchError(ValueError):
    """Something in a file goes beyond one of these bounds; the text says what."""


def unpacked_limit(packed: int, most: int = CHUNK_BYTES) -> int:
    """Return how many bytes something packed may become."""
    return min(most, max(UNPACKED_BYTES, UNPACKED_RATIO * packed))


def file_limit(packed: int) -> int:
    """Return how many bytes all of a file may become."""
    return max(FILE_BYTES, UNPACKED_RATIO * packed)


class Allowance:
    """What the chunks or messages of a file of so many bytes may unpack to together."""

    def __init__(self, packed: int) -> None:
        self._limit = self._left = file_limit(packed)

    def take(self, size: int) -> None:
        """Count the bytes of one more; `TooMuchError` where all are more than the file may become."""
        self._left -= size
        if self._left < 0:
            raise TooMuchError(f"its parts unpack to more than {self._limit:,} bytes together")
