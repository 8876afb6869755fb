"""Text tables that end in the middle of a row."""

from __future__ import annotations

from typing import TYPE_CHECKING

from formats.content import TextStream
from formats.errors import DamagedError, FormatError

if TYPE_CHECKING:
    from formats.recovery import Recovery

#: Bytes that wait for the end of the file, so that a row which is cut off can be left out.
_HELD = 1 << 16
#: Read at once from packed data: what is lost of the last read, where they end too early.
_PACKED = 1 << 10


class SalvagedText(TextStream):
    """The text of a file up to the last row that is surely whole.

    A row without an end of line may have lost digits of its last number, so it is left out.
    """

    def __init__(self, path: str, file: str) -> None:
        #: How packed data end, where they end too early.
        self.cut_short = ""
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
        """Read `size` bytes of UTF-8, fewer only at the end."""
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
