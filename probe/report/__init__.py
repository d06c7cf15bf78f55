"""A run as a person would show it to a colleague: a page and figures for a paper."""

from probe.report.write import write_report

__all__ = ["write_report"]
