"""The report: one page that holds everything, and fetches nothing."""

from __future__ import annotations

from terrain_cli.views.report.page import page, write
from terrain_cli.views.report.page_parts import Chart, Section, Table
from terrain_cli.views.report.written_sections import history

__all__ = ["Chart", "Section", "Table", "history", "page", "write"]
