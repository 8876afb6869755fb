"""Headers of tables that mean a time beside those that `channels` knows: exporters' and other languages'."""

from __future__ import annotations

import re
import unicodedata
from typing import TYPE_CHECKING, NamedTuple

from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from terrain_cli.vocabulary.units import Unit

# Left out because they also mean something else: temps (temperatures), tick and ticks, index, frame,
# seq and date (a row of numbers or days, of no unit), duration and period (of each test).
_WORDS = frozenset(
    (  # noqa: SIM905 - as a list it would take three pages
        "ts tstamp t_stamp times clock clock_time elapsed elapsed_time time_elapsed epoch epoch_time unix "
        "unix_time unixtime unix_timestamp posix_time utc utctime utc_timestamp utc_datetime "
        "timestamp_utc gmt date_time datetime_utc iso_time isotime time_iso t_rel t_abs rel_time "
        "relative_time time_rel time_relative abs_time absolute_time time_abs time_since_start "
        "seconds_since_start uptime up_time runtime run_time time_boot boot_time monotonic monotonic_time "
        "sim_time simtime simulation_time ros_time rostime bag_time bagtime rosbag_timestamp log_time "
        "logtime rec_time record_time recv_time receive_time received_at pub_time publish_time msg_time "
        "message_time header_stamp wall_time walltime wall_clock system_time sys_time device_time "
        "sensor_time sample_time measurement_time mission_time mission_elapsed_time met sclk scet "
        "spacecraft_clock gps_time gpstime gps_seconds gps_tow time_of_week tow time_of_day zeit "
        "zeitstempel zeitpunkt uhrzeit messzeit laufzeit datum_zeit heure horodatage horodate instant "
        "tiempo hora marca_de_tiempo marca_temporal fecha_hora tempo orario data_ora data_hora "
        "carimbo_de_tempo tijd tijdstempel tijdstip tid tidpunkt tidsstempel tidsstämpel aika aikaleima "
        "czas znacznik_czasu čas cas idő ido zaman timp vrijeme vreme waktu thời_gian время час "
        "метка_времени χρόνος "
        "時間 時刻 时间 时刻 时间戳 時間戳 タイムスタンプ 시간 시각 타임스탬프 समय الوقت زمن זמן"
    ).split()
)
#: Where a topic's name stands before it: /wheel/header/stamp, msg.timestamp.
_LEAVES = frozenset({"time", *CHANNELS["time"].aliases})
#: What `rostopic echo -p` and rosbag_to_csv write is in ns, whatever the header is called.
_NANOSECONDS = re.compile(r"%time|field\.(.*\.)?stamp|rosbagTimestamp")
_BRACKETS = re.compile(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]$")
_ENDING = re.compile(r"(.+)[_./](.+)$")
_FRACTION = re.compile(r"(?P<stem>.*?)(?P<unit>n(?:ano)?secs?|usecs?)$", re.IGNORECASE)
#: Beside one of these, seconds are those of a minute.
_PARTS_OF_A_DAY = frozenset({"min", "minute", "minutes", "h", "hour", "hours"})


class TimeName(NamedTuple):
    """Columns that may be the time."""

    #: One, or whole seconds and what is beyond them.
    headers: tuple[str, ...]
    #: Of the last.
    unit: Unit


def pairs(headers: Sequence[str]) -> list[TimeName]:
    """Find the columns of whole seconds that have another of what is beyond them (secs, nsecs)."""
    found = []
    for header in headers:
        match = _FRACTION.fullmatch(header)
        unit = units.parse(match["unit"].lower(), "time") if match else None
        wholes = {f"{match['stem']}{ending}".casefold() for ending in ("sec", "secs")} if match else set()
        whole = next((other for other in headers if other.casefold() in wholes), None)
        if whole and unit:
            found.append(TimeName((whole, header), unit))
    return found


def names(headers: Iterable[str]) -> list[TimeName]:
    """Find the columns whose names mean a time, among those that `channels` does not know."""
    plain = {header: _plain(header) for header in headers}
    of_a_day = not _PARTS_OF_A_DAY.isdisjoint(plain.values())
    found = []
    for header, text in plain.items():
        unit = _unit(header, text)
        if unit and not (of_a_day and units.parse(text, "time")):
            found.append(TimeName((header,), unit))
    return found


def _plain(header: str) -> str:
    """Spell a header in one way: rosTime, "ROS time" and __ros_time are one."""
    text = unicodedata.normalize("NFKC", header)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", text).casefold()
    return re.sub(r"[_\s-]+", "_", text).strip("_%#/ ")


def _unit(header: str, text: str) -> Unit | None:
    """Return the unit of a header that means a time, seconds where it says none; else None."""
    if _NANOSECONDS.fullmatch(header.strip()):
        return units.parse("ns", "time")
    if len(text) > 1 and text not in _PARTS_OF_A_DAY and (unit := units.parse(text, "time")):
        return unit
    if _means_time(text):
        return CHANNELS["time"].unit
    for pattern in (_BRACKETS, _ENDING):
        match = pattern.fullmatch(text)
        if match and _means_time(match[1].strip("_")):
            unit = units.parse(match[2], "time")
            # A bracket may also say which clock it is: elapsed (UTC).
            return unit or (CHANNELS["time"].unit if match[2] in _WORDS else None)
    return None


def _means_time(name: str) -> bool:
    return name in _WORDS or re.split(r"[./]", name)[-1] in _LEAVES
