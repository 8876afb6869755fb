"""The report: from a comparison to one page of HTML that holds everything, and fetches nothing."""

import gzip
import re
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from typing import Any

import formats
from terrain_cli.comparison.comparison_outcome import Comparison, as_estimated
from terrain_cli.improvement.change_trial import Alternative
from terrain_cli.presentation.terminal import put
from terrain_cli.version import __version__
from terrain_cli.views import chart_style
from terrain_cli.vocabulary.next_commands import Asked

# Before its libraries are imported: it says which extra brings them.
chart_style.need("report")

import platformdirs  # noqa: E402
from jinja2 import Environment, StrictUndefined  # noqa: E402

from terrain_cli.views.report import model_sections, sections  # noqa: E402
from terrain_cli.views.report.model_sections import history  # noqa: E402
from terrain_cli.views.report.page_parts import Chart, Section, Table  # noqa: E402

__all__ = ["Chart", "Section", "Table", "history", "page", "write"]


def write(comparison: Comparison, path: str | Path, **options: Any) -> None:
    """Write the report of a comparison into a file; as `page`."""
    chart_style.need("report")
    put(page(comparison, **options), str(path))


def page(
    comparison: Comparison,
    *,
    models: Sequence[Alternative] = (),
    further: Sequence[Section] = (),
    asked: Asked | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> str:
    """Return the report of a comparison; `further` sections follow, if there is something in them."""
    comparison = as_estimated(comparison)
    shown, choices, chosen = sections.of(comparison, progress, asked)
    by_model = model_sections.section(models)
    kept = [section for section in (*shown, by_model, *further) if section]
    charts = [part for section in kept for part in section.parts if isinstance(part, Chart)]
    here = files("terrain_cli.views.report")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "sort_keys": True}
    environment.filters["unbroken"] = lambda text: re.sub(r" (?=[^(]*\))", "\N{NO-BREAK SPACE}", text)
    environment.tests["chart"] = lambda part: isinstance(part, Chart)
    progress("page")
    return environment.from_string(here.joinpath("page.html").read_text("utf-8")).render(
        title="Wheel and soil: " + ", ".join(dict.fromkeys(wheel.source for wheel in comparison.wheels)),
        style=here.joinpath("page.css").read_text("utf-8"),
        library=_library() if charts else "",
        specs=[chart.spec for chart in charts],
        number_of=lambda chart: next(j for j, one in enumerate(charts) if one is chart),
        sections=kept,
        choices=choices,
        chosen=chosen,
        models=model_sections.choices(models) if by_model else ([], ""),
        version=__version__,
    )


@cache
def _library() -> str:
    """Vega with Vega-Lite and its embedding, as one script; kept, as to join it takes as long as the page."""
    kept = platformdirs.user_cache_path("terrain-est", appauthor=False)
    kept /= f"vega-of-vl-convert-{metadata.version('vl-convert-python')}.js.gz"
    with suppress(OSError, EOFError, zlib.error):
        if library := gzip.decompress(kept.read_bytes()).decode():
            return library
    import vl_convert

    # Without a snippet it is the whole library, which its type does not say.
    library = vl_convert.javascript_bundle()  # type: ignore[call-arg]
    # A script ends at this tag wherever it stands, even within a string.
    library = library.replace("</script", "<\\/script")
    with suppress(OSError, formats.CannotWriteError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        with formats.replacing(str(kept)) as temporary:
            Path(temporary).write_bytes(gzip.compress(library.encode()))
    return library
