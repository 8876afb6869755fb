"""What a file holds, by its first bytes; its text as UTF-8, whatever it is packed in or cut off in."""

import codecs
import io
from typing import Any, NamedTuple

from formats.errors import DamagedError, FormatError, NotFoundError
from formats.limits import NUL_BYTES, UNPACKED_RATIO, file_limit
from formats.recovery import HINT, Recovery

HEAD_BYTES = 64  # Enough for every signature below
_HELD = 1 << 16  # Bytes that wait for the end of the file, so that a row which is cut off can be left out
_PACKED = 1 << 10  # Read at once from packed data: what is lost of the last read, where they end too early


class FileKind(NamedTuple):
    title: str  # As the head of an inspection calls it
    #: As a remark says that it was found.
    found: str
    endings: tuple[str, ...]
    piped: bool = False


FILE_KINDS = {
    "csv": FileKind("text table", "a text table", (".csv", ".tsv", ".txt"), piped=True),
    "parquet": FileKind("Parquet", "Parquet", (".parquet",), piped=True),
    "ros1": FileKind("ROS 1 bag", "a ROS 1 bag", (".bag",)),
    "mcap": FileKind("MCAP", "MCAP", (".mcap",)),
    "db3": FileKind("ROS 2 bag", "SQLite", (".db3",)),
}
#: Of these, messages of topics.
BAGS = ("ros1", "mcap", "db3")
COMPRESSED = ("gzip", "zstd", "bz2")
SIDE_FILES = ("-wal", "-journal")  # What SQLite keeps beside a database
#: First bytes → one of `FILE_KINDS` or `COMPRESSED`; all else is text.
_CONTENT = {
    b"#ROSBAG V2.0": "ros1",
    b"\x89MCAP0\r\n": "mcap",
    b"SQLite format 3\0": "db3",
    b"PAR1": "parquet",
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"BZh": "bz2",
}
_FOREIGN = {
    b"#ROSBAG V1": "a ROS bag of format 1: convert it with `rosbag fix`",
    b"PK\x03\x04": "a zip archive or an Excel workbook: unpack it, or save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old Excel workbook: save the sheet as CSV",
    b"\x89HDF": "an HDF5 or MATLAB file: export it as CSV or Parquet",
    b"MATLAB 5.0": "a MATLAB file: export it as CSV or Parquet",
    b"ARROW1": "an Arrow (Feather) file: save it as Parquet",
    b"\xfd7zXZ": "packed with xz: unpack it first (gzip, bzip2 and zstd are read as they are)",
}
#: The mark of UTF-32 begins with that of UTF-16.
_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def content(path: str, head: bytes) -> str:
    """Tell by its first bytes what a file holds: of `COMPRESSED`, or of `FILE_KINDS`, "csv" for any text."""
    if not head:
        raise FormatError(path, "is empty")
    for magic, kind in _CONTENT.items():
        if head.startswith(magic):
            return kind
    for magic, what in _FOREIGN.items():
        if head.startswith(magic):
            raise FormatError(path, f"is {what}")
    return "csv"


def failure(path: str, error: OSError) -> FormatError:
    """Say in words why a file could not be opened or read."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return NotFoundError(path, "no such file or folder")
    if isinstance(error, PermissionError):
        return NotFoundError(path, "no permission to read it")
    return FormatError(path, f"cannot be read: {error.strerror or error}")


def first_bytes(path: str, file: str) -> bytes:
    """Read at most `HEAD_BYTES` of a file; `path` is what the user named it, `file` where it is."""
    try:
        with open(file, "rb") as stream:  # noqa: PTH123 (paths are strings throughout formats)
            return stream.read(HEAD_BYTES)
    except OSError as error:
        raise failure(path, error) from error


class TextStream(io.RawIOBase):
    """The text of a plain or compressed file as bytes of UTF-8, checked while they are read."""

    def __init__(self, path: str, file: str) -> None:
        import pyarrow as pa

        super().__init__()
        self.path = path
        self._line = 1
        self.nul_bytes = 0  # NUL bytes passed over so far: a power cut leaves them at the end of a log
        self.quote_marks = 0  # Quote marks so far; a table that closes each has an even number
        #: Whether the last byte read so far ends a line.
        self.ended_in_newline = True
        head = first_bytes(path, file)
        kind = content(path, head)
        #: "gzip", "zstd", "bz2" or "".
        self.packing = kind if kind in COMPRESSED else ""
        self._inner: Any = pa.OSFile(file)
        self._unpacked, self._limit = 0, file_limit(self._inner.size())
        if self.packing:
            self._inner = pa.CompressedInputStream(self._inner, self.packing)
        self._buffer = self._unpack(HEAD_BYTES)
        inner = content(path, self._buffer)
        if inner != "csv":
            raise FormatError(path, f"is a {inner} file packed with {self.packing}: unpack it first")
        mark = next((mark for mark in _MARKS if self._buffer.startswith(mark)), b"")
        self.encoding = _MARKS.get(mark, "utf-8")  # "utf-8", or UTF-16 or UTF-32 by that mark
        if b"\0" in self._buffer and self.encoding == "utf-8":
            hint = "text must be UTF-8, or UTF-16 or UTF-32 with its byte-order mark"
            raise self._not_text("is binary, of a kind that is not read", hint)
        self._decoder = codecs.getincrementaldecoder(self.encoding)()
        # An editor that does not know the mark may have put its own before it.
        while mark and self._buffer.startswith(mark):
            self._buffer = self._buffer.removeprefix(mark)
        self._buffer = self._as_utf8(self._buffer)

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        if not self.closed:
            self._inner.close()
        super().close()

    def read(self, size: int = -1) -> bytes:
        """Read `size` bytes of UTF-8, fewer only at the end."""
        size = size if size >= 0 else 1 << 20
        while len(self._buffer) < size:
            data = self._unpack(size - len(self._buffer))
            self._buffer += self._as_utf8(data)
            if not data:
                break
        out, self._buffer = self._buffer[:size], self._buffer[size:]
        if out:
            self.ended_in_newline = out.endswith((b"\n", b"\r"))
        return out

    def _unpack(self, size: int) -> bytes:
        try:
            data = bytes(self._inner.read(size))
        except OSError as error:
            if "runcated" in str(error):
                what = f"is cut off: its {self.packing} data end too early"
                raise DamagedError(self.path, what, hint=HINT) from error
            if self.packing:
                what = f"its {self.packing} data are corrupt ({error})"
                hint = "copy it again: nothing tells from which place on they are wrong"
                raise DamagedError(self.path, what, hint=hint) from error
            raise failure(self.path, error) from error
        self._unpacked += len(data)
        if self.packing and self._unpacked > self._limit:
            what = f"unpacks to more than {self._limit:,} bytes, {UNPACKED_RATIO} times its size"
            raise DamagedError(self.path, what, hint="if that is right, unpack it first")
        return data

    def _not_text(self, what: str, hint: str) -> FormatError:
        """Say what is wrong with bytes that are no text, by what the name of the file promises."""
        for kind in FILE_KINDS.values():
            if kind.found != "a text table" and self.path.lower().endswith(kind.endings):
                what, hint = f"is not {kind.found}, though its name says so", "copy or record it again"
        return FormatError(self.path, what, hint=hint)

    def _as_utf8(self, data: bytes) -> bytes:
        import numpy as np

        # Nearly every log is plain ASCII, and that is cheap to see.
        if not (data and self.encoding == "utf-8" and data.isascii() and not self._decoder.getstate()[0]):
            try:
                data = self._decoder.decode(data, not data).encode()
            except UnicodeDecodeError as error:
                line = self._line + error.object[: error.start].count(b"\n")
                byte = error.object[error.start]
                what = f"line {line}: byte 0x{byte:02x} is not {self.encoding.upper()} text"
                hint = "save it as UTF-8, for instance with `iconv -f LATIN1 -t UTF-8`"
                raise self._not_text(what, hint) from error
        if b"\0" in data:
            self.nul_bytes += data.count(b"\0")
            data = data.replace(b"\0", b"")
        codes = np.frombuffer(data, np.uint8)
        # Faster than bytes.count where lines are short.
        self._line += int(np.count_nonzero(codes == ord("\n")))
        if self.nul_bytes > NUL_BYTES:
            what = f"up to line {self._line} there are more than {NUL_BYTES:,} NUL bytes"
            raise DamagedError(self.path, what, hint="leave them out: tr -d '\\0' < FILE > CLEAN.csv")
        if b'"' in data:
            self.quote_marks += int(np.count_nonzero(codes == ord('"')))
        return data


class SalvagedText(TextStream):
    """The text of a file up to its last end of line: a row without one may have lost digits of a number."""

    def __init__(self, path: str, file: str) -> None:
        self.cut_short = ""  # How packed data end, where they end too early
        #: Bytes of the last row, which is cut off.
        self.left_out = 0
        self._held = b""
        self._ended = False
        try:
            super().__init__(path, file)
        except FormatError as error:
            if not self.cut_short:
                raise
            raise DamagedError(path, f"{self.cut_short}, before anything can be unpacked") from error

    def read(self, size: int = -1) -> bytes:
        size = size if size >= 0 else 1 << 20
        while not self._ended and len(self._held) < size + _HELD:
            data = super().read(size + _HELD - len(self._held))
            self._held += data
            if not data:
                self._end()
        out, self._held = self._held[:size], self._held[size:]
        return out

    def account(self, recovery: Recovery, rows: int, following: int) -> None:
        """Tell what was left out once the text was read to its end, and the next row was `following`."""
        recovery.damage = [f"cut off: {self.cut_short}"] if self.cut_short else []
        if self.left_out:
            recovery.damage.append(f"cut off in row {following}, of which {self.left_out} bytes are there")
        recovery.read = rows
        recovery.bytes_read = (recovery.bytes_expected or 0) - self.left_out
        recovery.lost = [(None, None)] if recovery.damage else []

    def _end(self) -> None:
        self._ended = True
        whole = max(self._held.rfind(b"\n"), self._held.rfind(b"\r")) + 1
        if self.quote_marks % 2:
            # A quote that is never closed: the row with it is the last.
            quote = self._held.rfind(b'"')
            if quote > 0 and self._held[quote - 1 : quote] in {b",", b";", b"\t", b"\n", b"\r", b" "}:
                whole = min(whole, self._held.rfind(b"\n", 0, quote) + 1)
                self.quote_marks -= 1
        self.left_out += len(self._held) - whole
        self._held = self._held[:whole]
        self.ended_in_newline = True

    def _unpack(self, size: int) -> bytes:
        if not self.packing:
            return super()._unpack(size)
        try:
            return super()._unpack(min(size, _PACKED))
        except DamagedError as error:
            if "end too early" not in str(error):
                raise
            self.cut_short = f"its {self.packing} data end too early"
            return b""

    def _as_utf8(self, data: bytes) -> bytes:
        if not data:
            # What is left of a character that is cut off.
            self.left_out += len(self._decoder.getstate()[0])
            self._decoder.reset()
        return super()._as_utf8(data)
