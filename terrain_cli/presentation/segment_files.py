"""Where results go: by the ending of a file, one way for every verb that writes segments."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import formats
from terrain_cli.errors import UsageError
from terrain_cli.presentation import segment_topics

if TYPE_CHECKING:
    from terrain_cli.presentation.segment_table import Table

#: Layer → columns by which QGIS can colour it, the first unless asked for another.
STYLES = {
    "segments": ("strength_at_stress_kPa", "strength_kPa", "c_kPa", "phi_deg"),
    "samples": ("slip", "sinkage_m", "load_N", "torque_Nm"),
}
_MCAP = ".mcap"


def check(output: str | None, samples: str | None = None, crs: str | None = None) -> None:
    """Check before the work whether its results can be written, by the endings and the reference system."""
    kinds = {_kind(path) for path in (output, samples) if path}
    if not crs:
        return
    try:
        formats.check_crs(crs)
        if "parquet" in kinds:
            from formats.output.common_forms import projjson

            projjson(crs)
    except formats.FormatError as error:
        raise UsageError(f"--crs {error}", hint=error.hint) from None


def write(
    table: Table, output: str | None, crs: str | None, samples: tuple[Table, str] | None = None
) -> None:
    """Write segments, and samples if there are any, the segments last: what reads them may stop early.

    The `output` "-" is the standard output, None nothing. Samples go into the GeoPackage of the segments as
    its second layer, if it is the same file.
    """
    both = samples is not None and output is not None and together(output, samples[1])
    if samples and not both:
        formats.write_table(samples[0], samples[1], crs=crs, layer="samples", graduated=STYLES)
    if output is None:
        return
    if _kind(output) == "mcap":
        segment_topics.write(table, output, crs)
        return
    layers = {"samples": samples[0]} if samples and both else None
    formats.write_table(table, output, crs=crs, layers=layers, graduated=STYLES)


def together(output: str, samples: str) -> bool:
    """Tell whether segments and samples go into one file, as two layers."""
    return Path(output).resolve() == Path(samples).resolve() and _kind(output) == "gpkg"


def remark(output: str | None, crs: str | None) -> str:
    """Say what a person must know to read a file as it is meant; nothing if there is nothing to say."""
    if not output or not _kind(output).startswith("geojson") or _kind(output) == "geojson":
        return ""
    from formats.output.common_forms import is_wgs84

    if crs and is_wgs84(crs):
        return ""
    system = f"-a_srs {crs}" if crs else "-a_srs NONE, for x and y of a site frame"
    return f"{output}: GDAL takes every sequence of GeoJSON for WGS 84; add {system}"


def _kind(path: str) -> str:
    return "mcap" if Path(path).suffix.lower() == _MCAP else formats.output_kind(path)
